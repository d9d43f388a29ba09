"""A site appears complete or not at all, and only this machine can be asked for it."""

from __future__ import annotations

import argparse
import http.client
import threading

import pytest
from full_disk import no_file_beyond

from omnimj.documentation import site as publishing
from omnimj.documentation.server import open_server
from omnimj.documentation.site import SiteBuild, publish
from omnimj.errors import InputError, OmnimjError, OutputError

PARSER = argparse.ArgumentParser()


def silent(_phrase: str, _share: float) -> None:
    pass


@pytest.fixture
def quick(monkeypatch):
    """A site of two files is built in place of the whole one; its warnings can be given."""
    warnings: list[str] = []

    def build(folder, parser, execute, report):
        (folder / "assets").mkdir(parents=True)
        (folder / "assets" / "style.css").write_text("body {}")
        (folder / "index.html").write_text("x" * 10_000)
        return SiteBuild(folder, ("index.md",), tuple(warnings))

    monkeypatch.setattr(publishing, "build_site", build)
    return warnings


def test_a_site_goes_into_a_new_folder_with_its_parents(quick, tmp_path):
    site = publish(tmp_path / "deep" / "site", False, PARSER, False, silent)
    assert site.folder == tmp_path / "deep" / "site"
    assert {path.name for path in site.folder.iterdir()} == {"assets", "index.html"}
    assert [path.name for path in site.folder.parent.iterdir()] == ["site"], "nothing is left beside it"


def test_force_replaces_a_site_and_keeps_what_else_is_there(quick, tmp_path):
    folder = tmp_path / "site"
    publish(folder, False, PARSER, False, silent)
    (folder / "CNAME").write_text("mine")
    (folder / "assets" / "old.css").write_text("old")
    with pytest.raises(InputError, match="is not empty"):
        publish(folder, False, PARSER, False, silent)
    publish(folder, True, PARSER, False, silent)
    assert (folder / "CNAME").read_text() == "mine" and not (folder / "assets" / "old.css").exists()


def test_a_warning_of_the_generator_leaves_nothing_behind(quick, tmp_path):
    quick.append("page a.md links to b.md, which is not there")
    with pytest.raises(OmnimjError, match=r"^omnimj docs: page a.md links to b.md"):
        publish(tmp_path / "site", False, PARSER, False, silent)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_nothing_behind(quick, tmp_path):
    refusal = r"^--out .*site: cannot be written, file too large"
    with no_file_beyond(5_000), pytest.raises(OutputError, match=refusal):
        publish(tmp_path / "site", False, PARSER, False, silent)
    assert list(tmp_path.iterdir()) == []


def test_the_server_listens_on_this_machine_alone_and_serves_the_folder(tmp_path):
    (tmp_path / "index.html").write_text("<p>here</p>")
    with open_server(0, tmp_path) as server:
        assert server.server_address[0] == "127.0.0.1"
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            found = {}
            for path in ("/index.html", "/../secret", "/nothing"):
                connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
                connection.request("GET", path)
                response = connection.getresponse()
                found[path] = (response.status, response.read())
                connection.close()
        finally:
            server.shutdown()
            thread.join()
    assert found["/index.html"] == (200, b"<p>here</p>")
    assert found["/../secret"][0] == found["/nothing"][0] == 404


def test_a_port_that_is_taken_is_said_in_one_line(tmp_path):
    with open_server(0, tmp_path) as server:
        taken = rf"^--port {server.server_port}: cannot be used, "
        with pytest.raises(InputError, match=taken), open_server(server.server_port, tmp_path):
            pass
