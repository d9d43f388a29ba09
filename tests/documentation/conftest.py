"""The site built once, with the tutorials as they are written."""

from __future__ import annotations

import pytest

from omnimj.cli.main import make_parser
from omnimj.documentation.site import SiteBuild, build_site


def silent(_phrase: str, _share: float) -> None:
    pass


@pytest.fixture(scope="session")
def site(tmp_path_factory) -> SiteBuild:
    return build_site(tmp_path_factory.mktemp("documentation") / "site", make_parser(), False, silent)
