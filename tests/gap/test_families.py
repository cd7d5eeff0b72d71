"""Effects that belong to one component are reported as this component."""

from collections.abc import Callable

import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.families import FAMILIES, expected_of
from dpr_lab.gap.conclusion.notes import component_notes
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.causes import NamedFamily
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Joints
from dpr_lab.run import Run
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record

ROTOR, FRICTION = "rotor_inertia_joint2", "coulomb_joint2"


def test_every_part_of_a_family_is_an_effect_and_every_mark_is_a_part():
    for family in FAMILIES:
        assert set(family.marks) <= set(family.parts) <= set(EFFECTS)
        assert set(family.expected) <= set(family.parts)


def test_friction_alone_is_a_bearing_and_parts_of_two_joints_are_no_drive():
    first, second = FAMILIES
    assert second.among((ROTOR, FRICTION)) == (ROTOR, FRICTION)
    assert not second.among((FRICTION, "hysteresis_joint2"))
    assert not first.among((ROTOR, FRICTION))
    assert not second.among((ROTOR,))


@pytest.mark.slow
def test_a_geared_drive_is_named_as_one(recorded: Callable[..., list[Run]], paper: Rig):
    runs = recorded({ROTOR: {"inertia_kgm2": 3e-4}, FRICTION: {"torque_Nm": 2e-3}}, duration=2.5)
    diagnosis = diagnose(runs, paper, library={name: EFFECTS[name] for name in (ROTOR, FRICTION, "coulomb_joint1")})
    (drive,) = diagnosis.families
    assert drive.name == "drive_joint2"
    assert set(drive.effects) == {ROTOR, FRICTION}
    assert drive.share == pytest.approx(1.0, abs=0.05)
    assert any("may be the effects of a geared drive, joint 2 [drive_joint2]; " in note for note in diagnosis.notes)


@pytest.mark.parametrize(
    ("geared", "words"), [((2,), "are the effects"), ((), "may be the effects"), ((1,), "may be the effects")]
)
def test_a_drive_that_the_rig_file_does_not_state_is_only_possible(geared, words):
    drive = NamedFamily(
        name="drive_joint2", words="geared drive, joint 2", effects=[ROTOR, FRICTION], probability=0.9, share=0.7
    )
    (note,) = component_notes([drive], geared)
    assert note.startswith(f"{ROTOR} and {FRICTION} {words} of a geared drive, joint 2 [drive_joint2]; together")
    assert "70 % of the excess" in note


@pytest.mark.slow
def test_a_drive_that_the_rig_file_states_is_always_in_the_model(recorded, paper: Rig):
    runs = recorded({FRICTION: {"torque_Nm": 2e-3}, ROTOR: {"inertia_kgm2": 2e-7}}, duration=2.0)[:2]
    geared = paper.model_copy(update={"joints": Joints(geared=(2,))})
    library = {name: EFFECTS[name] for name in expected_of(geared.joints.geared)}
    diagnosis = diagnose(runs, geared, library=library)
    assert ROTOR in diagnosis.model_effects
    assert ROTOR not in diagnose(runs, paper, library=library).model_effects
    assert any("a geared motor on joint 2" in assumption for assumption in diagnosis.assumptions)


@pytest.mark.slow
def test_what_a_geared_rig_cannot_show_is_not_in_the_model(paper: Rig):
    alone = paper.model_copy(update={"joints": Joints(geared=(1, 2))}).with_rods("inner")
    runs = record(load_plant("paper", 3), alone, 4.0, 500)
    diagnosis = diagnose(runs, alone, library={name: EFFECTS[name] for name in expected_of((1, 2))})
    assert diagnosis.verdict == "no_gap"
    assert not [name for name in diagnosis.model_effects if name.endswith("joint2")]


@pytest.mark.slow
def test_two_causes_that_are_no_family_stay_two(two_found: Diagnosis):
    assert two_found.families == []
