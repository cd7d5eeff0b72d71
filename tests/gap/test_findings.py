"""Sensor findings of a diagnosis, as saved and loaded."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from dpr_lab.gap.result.finding import SensorFinding

FINDINGS = TypeAdapter(list[SensorFinding])
STEP = SensorFinding("reading_step", "X1", "joint1", 1.3, "0.01 rad", step=0.01)


def test_the_size_of_a_step_is_no_part_of_a_saved_finding() -> None:
    (loaded,) = FINDINGS.validate_json(FINDINGS.dump_json([STEP]))
    assert loaded == STEP
    (saved,) = FINDINGS.dump_python([STEP])
    (loaded,) = FINDINGS.validate_python([{**saved, "step": 0.01}])
    assert loaded.step is None


def test_an_instant_that_is_not_a_number_is_refused() -> None:
    with pytest.raises(ValidationError, match="finite"):
        FINDINGS.validate_python([replace(STEP, at_s=np.nan)])
