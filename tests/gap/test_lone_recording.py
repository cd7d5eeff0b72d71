"""A remainder in only one recording is reported, and no effect has a high probability."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.classes.posterior import EffectPosterior
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.transfer.lone_recording import LoneRecording, exceptional
from dpr_lab.gap.transfer.outcome import Transfer
from dpr_lab.gap.transfer.transfer import judged
from tests.background_rigs import law, record, rig_and_base


@pytest.mark.parametrize(
    ("remainder", "others", "is_alone"),
    [(3.9, 0.6, True), (1.6, 0.0, True), (1.4, 0.0, False), (40.0, 17.0, False), (60.0, 17.0, True)],
    ids=["clear", "near the noise", "noise", "all alike", "above small unknown causes"],
)
def test_only_a_remainder_that_the_other_recordings_lack_is_alone(remainder, others, is_alone):
    assert exceptional("run1", remainder, others) == (LoneRecording("run1", remainder, others) if is_alone else None)


def test_no_effect_is_sure_while_one_recording_contradicts():
    closed = Interval(value=0.9, interval90=(0.8, 0.95))
    agreed = Transfer("releases left out", True, closed, 5.0, (), {}, {}, {}, (), (), (), None)
    posterior = EffectPosterior("coulomb_joint1", ("coulomb_joint1",), (), 0.98)
    assert [p.probability for p in judged(agreed, [posterior], forced=False, remainder=False)] == [0.98]
    contradicted = replace(agreed, lone=LoneRecording("run0", 3.9, 0.6))
    assert [p.probability for p in judged(contradicted, [posterior], forced=False, remainder=False)] == [0.49]


@pytest.mark.slow
def test_a_recording_that_was_disturbed_is_named_and_the_others_are_explained():
    rng = np.random.default_rng(6)
    rig, base = rig_and_base(rng, rods=1)
    dry, wander = law("coulomb", 0, 5.0), law("wander", 0, 3.0)
    acting = ([dry], [dry, wander], [dry])
    runs = [record(rig, base, laws, rng, "X2", 4.0, rods=1) for laws in acting]
    runs = [replace(run, name=f"run{i}") for i, run in enumerate(runs)]
    library = {"coulomb_joint1": EFFECTS["coulomb_joint1"]}
    diagnosis = diagnose(runs, rig, library=library)
    (note,) = (note for note in diagnosis.notes if "Either a cause acted only in run1" in note)
    assert re.fullmatch(
        r"The model leaves a remainder of .* times the noise in run1\. If run1 is not fitted, .* without it\.", note
    )
    assert all(effect.probability <= 0.5 for effect in diagnosis.effects)
    others = diagnose([runs[0], runs[2]], rig, library=library)
    assert others.verdict == "named"
    assert others.effects[0].probability > 0.9
