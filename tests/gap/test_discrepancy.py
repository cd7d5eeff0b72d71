"""Model discrepancy term: it has the size of the remainder, and widens the intervals of the named effects."""

import re
from collections.abc import Callable

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.diagnose import diagnose
from tests.background_rigs import law, recordings, rig_and_base

LIBRARY = {name: EFFECTS[name] for name in ("coulomb_joint1", "spring_joint2")}


@pytest.mark.slow
def test_the_remainder_is_the_torque_that_no_effect_of_the_library_makes(few_readings: Callable[[str], None]) -> None:
    few_readings("no interpretation is expected")
    small = 6e-4  # N m, sin(3 angle): 4.2e-4 rms over a turn
    rig, runs, _ = recordings(7, [law("coulomb", 0, 6), law("third", 0, 0.6)])
    diagnosis = diagnose(runs, rig, library=LIBRARY)
    assert diagnosis.effects[0].name == "coulomb_joint1"
    unit = diagnosis.scale_b / rig_and_base(np.random.default_rng(7))[1][1]
    torque = diagnosis.gap.remainder_Nm
    assert torque["joint1"] == pytest.approx(unit * small / 2**0.5, rel=0.4)
    assert torque["joint2"] < 0.5 * torque["joint1"]
    [remainder] = diagnosis.notes
    assert remainder.startswith("Unmodelled remainder: ")
    assert "mN m rms in joint 1" in remainder
    assert len(re.findall(r"\.(?= |$)", diagnosis.sentence)) == 3  # causes, gap reduction, remainder
    size = diagnosis.effects[0].parameters["torque_Nm"]
    assert size.interval90[0] < unit * 6e-3 < size.interval90[1]
