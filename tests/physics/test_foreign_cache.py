"""Cache files with the content of something else cost a compilation and a line in the log, never a run."""

from __future__ import annotations

import importlib
import logging
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest
from full_disk import no_file_beyond

from omnimj.physics import native

SOURCE = """
from omnimj.physics.native import kernel

@kernel
def twice(x):
    return 2.0 * x
"""
WORD = "compiling twice again: its file in the cache is damaged"
FOREIGN = {
    "a number": pickle.dumps(1),
    "a text": pickle.dumps("text"),
    "a table": pickle.dumps({"overloads": 1}),
    "an array": pickle.dumps(np.zeros(3)),
    "a huge length": b"\x80\x05\x96" + b"\xff" * 8,
    "a class of nobody": b"cnowhere\nNothing\n.",
    "an archive": b"PK\x03\x04" + bytes(60),
    "nothing": b"",
}


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """Folder of a module with one kernel, compiled once, and the content of its two cache files."""
    folder = tmp_path_factory.mktemp("foreign")
    (folder / "foreign_kernel.py").write_text(SOURCE)
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(str(folder))
        patched.setattr(native, "cache_folder", lambda package: folder / "cache")
        module = importlib.import_module("foreign_kernel")
        assert module.twice(2.0) == 4.0
        yield module, {file: file.read_bytes() for file in (folder / "cache").rglob("*.nb?")}
        sys.modules.pop("foreign_kernel")


@pytest.mark.parametrize("content", FOREIGN)
@pytest.mark.parametrize("kind", [".nbi", ".nbc"])
def test_foreign_content_is_replaced_with_a_word(cache, caplog, content, kind):
    module, files = cache
    assert len(files) == 2
    for file, good in files.items():
        Path(file).write_bytes(FOREIGN[content] if file.suffix == kind else good)
    with caplog.at_level(logging.WARNING, "omnimj.native"):
        assert importlib.reload(module).twice(3.0) == 6.0
    # an index that begins with any other value is for numba one of another version, which it replaces itself
    silent = kind == ".nbi" and content in ("a number", "a text", "a table")
    assert caplog.messages == [WORD] * (not silent)
    caplog.clear()
    again = importlib.reload(module)
    assert again.twice(4.0) == 8.0 and sum(again.twice.stats.cache_hits.values()) == 1
    assert not caplog.messages


def test_a_cache_on_a_full_disk_costs_a_word_and_no_run(tmp_path, monkeypatch, caplog):
    (tmp_path / "kernel_on_full_disk.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(native, "cache_folder", lambda package: tmp_path / "cache")
    with no_file_beyond(100), caplog.at_level(logging.WARNING, "omnimj.native"):
        assert importlib.import_module("kernel_on_full_disk").twice(2.0) == 4.0
    assert caplog.messages == [f"compiled code cannot be kept in {tmp_path / 'cache'}: File too large"]
    assert not list((tmp_path / "cache").rglob("*.nb?"))


def test_the_index_of_one_file_in_place_of_the_other_is_foreign_too(cache):
    module, files = cache
    index, code = sorted(files, key=lambda file: file.suffix != ".nbi")
    code.write_bytes(files[index])
    index.write_bytes(files[index])
    assert importlib.reload(module).twice(3.0) == 6.0
