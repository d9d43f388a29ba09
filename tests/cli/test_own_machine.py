"""`Your own machine in ten minutes`, word for word: a bare MJCF file and CSV logs that scipy integrates."""

import json
import re
import shlex
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import omnimj
from omnimj.cli.main import main

PAGE = (Path(omnimj.__file__).parent / "docs" / "any_machine.md").read_text(encoding="utf-8")
MASS, ARM, INERTIA, DAMPING, MISSING = 0.8, 0.3, 0.004, 0.02, 0.06
CRANE = f"""<mujoco model="crane">
  <worldbody>
    <body name="boom">
      <inertial pos="0 0 -{ARM}" mass="{MASS}" diaginertia="{INERTIA} {INERTIA} 0.0002"/>
      <joint name="pivot" axis="0 1 0" damping="{DAMPING}"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="drive" joint="pivot"/>
  </actuator>
</mujoco>
"""


def write_logs(folder, runs, seconds):
    """Write CSV files of I q'' = u - m g l sin q - (d + d_missing) q', with noise."""
    generator = np.random.default_rng(1)
    folder.mkdir(parents=True)
    time = np.arange(0.0, seconds, 0.005)
    for k in range(runs):
        size, slow, fast, phase = generator.uniform([0.6, 0.3, 0.9, 0.0], [1.4, 0.7, 1.8, 6.0])

        def torque(t, size=size, slow=slow, fast=fast, phase=phase):
            return size * np.sin(2.0 * np.pi * slow * t + phase) + 0.6 * np.sin(2.0 * np.pi * fast * t)

        def motion(t, state, torque=torque):
            weight = MASS * 9.81 * ARM * np.sin(state[0])
            force = torque(t) - weight - (DAMPING + MISSING) * state[1]
            return state[1], force / (INERTIA + MASS * ARM**2)

        angle = solve_ivp(motion, (0.0, seconds), (0.0, 0.0), t_eval=time, rtol=1e-9, atol=1e-10).y[0]
        noise = generator.standard_normal((2, len(time)))
        columns = (time, angle + 2e-4 * noise[0], torque(time) + 2e-3 * noise[1])
        head = "time,position:pivot,control:drive"
        file = folder / f"run_{k + 1}.csv"
        np.savetxt(file, np.column_stack(columns), "%.6f", ",", header=head, comments="")


def follow_the_page():
    """Run the commands of the first block of the page."""
    (block, *_) = re.findall(r"```sh\n(.*?)```", PAGE, flags=re.DOTALL)
    lines = [shlex.split(line) for line in block.splitlines()]
    assert [line[:2] for line in lines] == [["omnimj", "import"], ["omnimj", "gap"]]
    for line in lines:
        words = [sorted(map(str, Path().glob(word))) if "*" in word else [word] for word in line[1:]]
        assert main([word for one in words for word in one]) == 0, line


def attributes(file):
    """Every attribute of an MJCF file by its place."""
    found = {}

    def visit(element, place):
        found.update({(place, key): value for key, value in element.attrib.items()})
        for k, child in enumerate(element):
            visit(child, f"{place}/{child.tag}[{k}]")

    visit(ElementTree.parse(file).getroot(), "")
    return found


@pytest.mark.parametrize(
    ("runs", "seconds"),
    [
        pytest.param(3, 2.0, id="small"),
        pytest.param(6, 8.0, id="whole", marks=pytest.mark.slow),
    ],
)
def test_the_page_leads_from_a_bare_file_and_logs_to_the_missing_friction(
    tmp_path, monkeypatch, capsys, undrawn, runs, seconds
):
    (tmp_path / "crane.xml").write_text(CRANE)
    write_logs(tmp_path / "logs", runs, seconds)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("omnimj.view.report.gap.MOST_FIGURES", 1)  # others test the report
    follow_the_page()
    shown = capsys.readouterr().out
    assert "Named: viscous (pivot)" in shown and "excited: pivot" in shown
    found = json.loads(Path("out/crane/gap.json").read_text(encoding="utf-8"))
    (effect,) = found["effects"]
    value = effect["parameters"]["coefficient"]
    assert (effect["effect"], effect["indistinguishable_from"]) == ("viscous", [])
    assert value["value"] == pytest.approx(MISSING, rel=0.05) and found["shrink"] > 0.8
    before, after = attributes("crane.xml"), attributes("out/crane/model.xml")
    changed = {key for key in before.keys() | after.keys() if before.get(key) != after.get(key)}
    assert [key for _, key in changed] == ["damping"]
    opened = mujoco.MjModel.from_xml_path("out/crane/model.xml")
    assert opened.dof_damping[0] == pytest.approx(DAMPING + value["value"], rel=1e-6)


def test_columns_with_the_names_of_a_dataset_keep_them_and_others_are_sensors(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    rows = "\n".join(f"{0.01 * k},{k % 7},{k % 5},{k % 3}" for k in range(60))
    head = "time,position:slew joint [deg],force:drive,speed"
    Path("a.csv").write_text(f"{head}\n{rows}\n")
    assert main(["import", "a.csv", "--plant", "mjcf", "--out", "data"]) == 0
    shown = capsys.readouterr().out
    for words in (r"deg\s.*position:slew joint", r"force:drive\s.*force:drive", r"speed\s.*sensor:speed"):
        assert re.search(words, shown), words
