"""Sets of real measurements: dataset folders, folders of a machine with its logs, and known public sets.

A machine's folder holds its model file (one MJCF file, or `robot.toml`, `rig.toml` or `axis.toml`), and
either datasets in folders of their own or logs, there or one folder below, with one `NAME.mapping.toml`.
`expected.toml` in it or in a dataset's folder states what is known of the machine:

```toml
source = "where this is from"
[expected."viscous (elbow)"]
coefficient = 0.4
```
"""

from __future__ import annotations

import hashlib
import math
import tarfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from omnimj.errors import InputError
from omnimj.parameters.reading import Rule, check_number, check_table, check_text, read_toml, require_keys
from omnimj.recording.dataset_file import DATASET_FILE
from omnimj.recording.importing.source import READERS
from omnimj.resources import models_folder

KNOWN_SETS = "real_sets.toml"
"""File of the known public sets, below the models."""
EXPECTED_FILE = "expected.toml"
"""File beside the logs of a user's set."""
MODEL_FILES = ("robot.toml", "rig.toml", "axis.toml")
"""Model files of the plants without an MJCF file of their own."""
_KEYS = ("get", "folders", "archive", "files", "mapping", "model", "floors", "source", "expected")
_ANY = Rule(-math.inf, math.inf, False)
_MAPPING = ".mapping.toml"

Expected = Mapping[str, Mapping[str, float]]
"""Label of an effect → published values of its parameters; none where only the effect is known."""


@dataclass(frozen=True)
class RealSet:
    """Set of measurements that is there."""

    name: str
    logs: tuple[Path, ...]
    """Folder of a dataset, or log files to import."""
    mapping: Path | None = None
    """Mapping of log files; None for a dataset."""
    model: Path | None = None
    """Model file; the plant's shipped one, or that of the dataset, when None."""
    floors: Path | None = None
    expected: Expected = field(default_factory=dict)
    source: str = ""
    """Origin of the expected effects."""

    def fingerprint(self) -> str:
        """Digest of all files that the result depends on."""
        inside = [
            sorted(p for p in one.rglob("*") if p.is_file()) if one.is_dir() else [one] for one in self.logs
        ]
        files = [file for part in inside for file in part if file.name != EXPECTED_FILE]
        files += [one for one in (self.mapping, self.model, self.floors) if one is not None]
        if self.model is not None and self.model.with_suffix(".toml").is_file():
            files.append(self.model.with_suffix(".toml"))
        digest = hashlib.sha256()
        for file in files:
            digest.update(file.name.encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
        return digest.hexdigest()


@dataclass(frozen=True)
class MissingSet:
    """Known public set that is not there."""

    name: str
    get: str
    """Where the measurements are, and where to put them."""


@dataclass(frozen=True)
class KnownSet:
    """Public set: where it may lie, how it is read, and what is published about it."""

    found: RealSet
    """The set without its logs."""
    get: str
    folders: tuple[str, ...]
    archive: str
    files: tuple[str, ...]

    def logs_in(self, folder: Path) -> tuple[Path, ...]:
        """Log files below the folder of the set."""
        return tuple(sorted(path for pattern in self.files for path in folder.glob(pattern)))

    def logs_below(self, folder: Path) -> tuple[Path, ...]:
        """Log files below a folder of several sets."""
        return next((logs for name in self.folders if (logs := self.logs_in(folder / name))), ())


def known_sets() -> tuple[KnownSet, ...]:
    """Read the known public sets.

    Raises:
      InputError: A value is missing or wrong.
      UnknownNameError: An unknown key.
    """
    path = models_folder() / KNOWN_SETS
    return tuple(_known_set(path, name, entry) for name, entry in read_toml(path).items())


def _known_set(path: Path, name: str, entry: Any) -> KnownSet:
    place = f"{path}: {name}"
    table = check_table(place, entry)
    require_keys(place, table, _KEYS)
    for key in ("get", "archive"):
        check_text(f"{place}.{key}", table.get(key))
    files = {
        key: path.parent / check_text(f"{place}.{key}", table[key]) for key in _KEYS[4:7] if key in table
    }
    expected = _expected(place, table)
    source = str(table.get("source", ""))
    found = RealSet(name, (), files.get("mapping"), files.get("model"), files.get("floors"), expected, source)
    folders, patterns = (_texts(f"{place}.{key}", table.get(key)) for key in ("folders", "files"))
    return KnownSet(found, str(table["get"]), folders, str(table["archive"]), patterns)


def _texts(place: str, value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not value:
        raise InputError(place, f"found {value!r}", "a list of strings is needed")
    return tuple(check_text(place, one) for one in value)


def _expected(place: str, table: Mapping[str, Any]) -> Expected:
    """Expected effects of a table with `expected` and `source`."""
    found = {}
    for label, values in check_table(f"{place}.expected", table.get("expected", {})).items():
        at = f"{place}.expected.{label}"
        found[label] = {
            k: float(check_number(f"{at}.{k}", v, _ANY)) for k, v in check_table(at, values).items()
        }
    if found:
        check_text(f"{place}.source", table.get("source"))
    return found


def find_sets(
    paths: Sequence[Path], data: Path | None, unpacked: Path, known: Sequence[KnownSet]
) -> tuple[list[RealSet], list[MissingSet]]:
    """Find the sets that are there, and name the known ones that are not.

    Args:
      paths: Dataset folders, machines' folders, or unpacked archives of known sets.
      data: Folder in which known sets are looked for, as folders or as archives; None to look for none.
      unpacked: Folder into which archives in `data` are unpacked.
      known: Known public sets.

    Returns:
      Sets that are there, each once; known sets that are not.

    Raises:
      InputError: A path holds no set, or two sets have one name.
    """
    found = [one for path in paths for one in _sets_of(path, known)]
    if data is not None:
        if not data.is_dir():
            raise InputError(f"--data {data}", "no such folder", "a folder with known sets is needed")
        given = {one.name for one in found}
        found += [one for one in _sets_below(data, unpacked, known) if one.name not in given]
    names = [one.name for one in found]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"set {name!r}", "is given twice", "folders with different names are needed")
    return found, [MissingSet(k.found.name, k.get) for k in known if k.found.name not in names]


def _sets_below(data: Path, unpacked: Path, known: Sequence[KnownSet]) -> Iterator[RealSet]:
    for one in known:
        logs = one.logs_below(data)
        if not logs and (data / one.archive).is_file():
            _unpack(data / one.archive, unpacked)
            logs = one.logs_below(unpacked)
        if logs:
            yield replace(one.found, logs=logs)


def _unpack(archive: Path, folder: Path) -> None:
    """Unpack an archive, once."""
    done = folder / f"{archive.name}.unpacked"
    if done.is_file():
        return
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tarfile.open(archive) as opened:
            if hasattr(tarfile, "data_filter"):  # missing in Python before 3.11.4
                opened.extractall(folder, filter="data")
            else:
                opened.extractall(folder)
    except (tarfile.TarError, EOFError, ValueError) as error:
        raise InputError(archive, "cannot be unpacked", " ".join(str(error).split())) from None
    done.touch()


def _sets_of(path: Path, known: Sequence[KnownSet]) -> list[RealSet]:
    """Sets in a folder given by the user."""
    if not path.is_dir():
        found = "is a file" if path.exists() else "no such folder"
        raise InputError(path, found, "the folder of a dataset or machine, or an unpacked archive, is needed")
    if (path / DATASET_FILE).is_file():
        return [_with_expected(RealSet(path.resolve().name, (path,)), path)]
    if model := _model_of(path):
        return list(_machine_sets(path, model))
    inside = path.resolve()
    found = []
    for one in known:
        logs = one.logs_in(path) or tuple(f for f in one.logs_in(inside.parent) if inside in f.parents)
        if logs:
            found.append(replace(one.found, logs=logs))
    if not found:
        names = ", ".join(one.found.name for one in known)
        rule = f"needed: {DATASET_FILE}, a model file beside logs, or the logs of a known set ({names})"
        raise InputError(path, "holds no set", rule)
    return found


def _model_of(folder: Path) -> Path | None:
    """Model file of a machine's folder; None if it is none."""
    files = sorted(folder.glob("*.xml"))
    if len(files) > 1:
        names = [file.name for file in files]
        raise InputError(folder, "has several MJCF files", "one machine per folder is needed", names)
    files = files or [folder / name for name in MODEL_FILES if (folder / name).is_file()]
    return files[0] if files else None


def _machine_sets(folder: Path, model: Path) -> Iterator[RealSet]:
    """Datasets and logs of a machine's folder."""
    floors = folder / "floors.toml" if (folder / "floors.toml").is_file() else None
    name = folder.resolve().name
    datasets = sorted(file.parent for file in folder.glob(f"*/{DATASET_FILE}"))
    for one in datasets:
        label = name if len(datasets) == 1 else f"{name}_{one.name}"
        yield _with_expected(RealSet(label, (one,), None, model, floors), folder, one)
    mappings = sorted(folder.glob(f"*{_MAPPING}"))
    if datasets:
        return
    if len(mappings) != 1:
        rule = f"datasets in folders of their own, or logs with one NAME{_MAPPING}, are needed"
        raise InputError(folder, f"has no datasets and {len(mappings)} mappings", rule)
    logs = sorted(f for f in (*folder.glob("*.*"), *folder.glob("*/*.*")) if f.suffix.lower() in READERS)
    if not logs:
        raise InputError(
            folder, "has a mapping and no logs", "logs are needed there or one folder below", READERS
        )
    yield _with_expected(RealSet(name, tuple(logs), mappings[0], model, floors), folder)


def _with_expected(one: RealSet, *folders: Path) -> RealSet:
    """The set with what the last of the folders that has a file of expected effects states."""
    for folder in reversed(folders):
        file = folder / EXPECTED_FILE
        if file.is_file():
            tree = read_toml(file)
            require_keys(file, tree, ("source", "expected"))
            return replace(one, expected=_expected(str(file), tree), source=str(tree.get("source", "")))
    return one
