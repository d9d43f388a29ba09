"""What the tests of tuning share."""

from __future__ import annotations

import pytest
from small_tuning import small_tuning

from omnimj.studies.tuning.study import TuningConfig


@pytest.fixture
def order(tmp_path) -> TuningConfig:
    return small_tuning(tmp_path)
