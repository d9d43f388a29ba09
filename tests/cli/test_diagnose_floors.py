"""`omnimj diagnose --floor-labels` from datasets to files, and what it refuses."""

import json

import pyarrow.parquet as pq
import pytest
from made_floor_logs import floors_toml, log, one_floor_logs, plan

from omnimj.cli.main import main
from omnimj.diagnosis.floor_labels import calibration
from omnimj.recording.write_dataset import DatasetWriter

pytestmark = pytest.mark.usefixtures("undrawn")

SOFT, HARD = 0, 1


def written(folder, runs):
    writer = DatasetWriter(folder, "uto_robot", {})
    for run in runs:
        writer.add(run)
    about = folder / "dataset.toml"
    text = about.read_text().replace('plant = "uto_robot"', 'plant = "uto_robot"\nwheels = 3', 1)
    text = text.replace("wheels = 3\nwheels = 3", "wheels = 3")
    about.write_text(f"{text}\n[defaults]\npose_measured = true\n")
    return folder


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    base, made = tmp_path_factory.mktemp("edge"), plan()
    (base / "floors.toml").write_text(floors_toml())
    labels = [(0.0, (HARD, HARD, SOFT)), (6.0, (HARD, SOFT, SOFT))]
    known = {"floor": "hard", "start_floors": "hard, hard, soft"}
    written(base / "edge", [log(made, "over", 0.4, labels, 3, conditions=known)])
    written(base / "single", one_floor_logs(made, many=4).runs)
    return base


@pytest.fixture(scope="module", autouse=True)
def learnt_once():
    """Noise and threshold are learnt from the runs on one floor at the first command only."""
    found, learn = [], calibration.calibrate_labels

    def first(plan, datasets):
        if not found:
            found.append(learn(plan, datasets))
        return found[0]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(calibration, "calibrate_labels", first)
        yield


def options(base, *more):
    names = "--model", "robotino", "--floors", str(base / "floors.toml"), "--floor-labels", "soft,hard"
    return (*names, "--calibrate-on", str(base / "single"), *more)


def test_crossings_are_printed_and_written(folders, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["diagnose", str(folders / "edge"), *options(folders, "--out", str(out))]) == 0
    printed = capsys.readouterr().out
    assert "hard, hard, soft" in printed and "wheel 2 to soft at" in printed
    content = json.loads((out / "floor_labels.json").read_text())
    run = content["runs"]["over"]
    assert run["start_floors"] == ["hard", "hard", "soft"]
    (crossing,) = run["crossings"]
    assert (crossing["wheel"], crossing["floor"]) == (2, "soft")
    assert crossing["time"] == pytest.approx(6.0, abs=0.5)
    table = pq.read_table(out / "over.parquet")
    assert {"floor_2", "probability_2_soft", "probability_2_hard"} <= set(table.column_names)
    both = [table[f"probability_2_{name}"].to_numpy() for name in ("soft", "hard")]
    assert sum(both) == pytest.approx(1.0)
    page = (out / "report.html").read_text()
    assert "wheel 2 to soft at" in page and "Probability that each wheel stands on hard." in page


def test_a_given_line_scores_the_labels_beside_chance(folders, tmp_path, capsys):
    out = tmp_path / "out"
    more = "--edge-line", "-0.5", "--out", str(out), "--json"
    assert main(["diagnose", str(folders / "edge"), *options(folders, *more)]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content == json.loads((out / "floor_labels.json").read_text())
    scores = content["scores"]
    # the robot of these logs never moves in the camera, far beyond the line
    assert scores["currents"]["crossings"] == 0 and scores["currents"]["false"] == 1
    assert set(scores["truth_shifted"]) == {"-0.5", "-0.25", "+0.25", "+0.5"}
    assert scores["no_change"]["false"] == 0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("--floor-labels", "soft"), "--floor-labels: found soft; two or more floors are needed"),
        (("--floor-labels", "soft,moon"), "--floor-labels: unknown floor 'moon'"),
        (("--edge-line", "left"), "argument --edge-line: found 'left'; an offset [m]"),
        (("--method", "robust"), "--method: is given beside --floor-labels"),
        (("--model", "uto_robot"), "has 4 [[wheels]]; the logs of"),
        (("--edge-line", "auto"), "--edge-line auto: found 1 runs; steady driving in each half"),
    ],
)
def test_unsuitable_options_are_refused_in_one_line(folders, refused, change, words):
    line = refused("diagnose", str(folders / "edge"), *options(folders, "--out", "out", *change))
    assert words in line


def test_options_that_need_each_other_are_refused_alone(folders, refused):
    edge = str(folders / "edge")
    assert "--edge-line: is given without --floor-labels" in refused(
        "diagnose", edge, "--edge-line", "1.5", "--out", "out"
    )
    assert "--floor-labels: --calibrate-on is missing" in refused(
        "diagnose", edge, "--floor-labels", "a,b", "--out", "out"
    )


def test_posed_logs_without_the_option_are_refused_with_a_word_on_it(folders, refused):
    floors = "--floors", str(folders / "floors.toml")
    line = refused("diagnose", str(folders / "edge"), *floors, "--model", "robotino", "--out", "out")
    assert "this command needs the inertial unit" in line and "--floor-labels" in line


@pytest.mark.parametrize(
    ("value", "words"),
    [('"hard, moon"', "start_floors: unknown floor 'moon'"), ("3", "a list with the floor under each wheel")],
)
def test_start_floors_must_be_known_floors(folders, refused, tmp_path, value, words):
    copy = tmp_path / "copy"
    copy.mkdir()
    for file in (folders / "edge").iterdir():
        (copy / file.name).write_bytes(file.read_bytes())
    about = copy / "dataset.toml"
    about.write_text(about.read_text().replace('"hard, hard, soft"', value))
    assert words in refused("diagnose", str(copy), *options(folders, "--out", "out"))
