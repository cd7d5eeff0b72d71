"""Reading of run files: time from the release, removed turns, compared rig."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dpr_lab.errors import RunError
from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.inspect import recover
from dpr_lab.storage.layout import RELEASED, sealed, unsealed
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.writer import RunWriter

RIG = load_rig("paper")


def changed(**tables):
    values = RIG.model_dump(mode="json", exclude_none=True)
    return Rig.model_validate({name: {**values[name], **tables.get(name, {})} for name in values})


def record(path, theta, release=1, pose="X2", summary=None, events=(), source="device", rig=RIG):
    with RunWriter(path, RunMetadata(rig, pose, 1000, source)) as writer:
        writer.samples(np.arange(len(theta)), np.round(RIG.positions(theta)).astype(np.int64))
        for kind, tick in events:
            writer.event(0, kind, tick)
        writer.finish(summary or RunSummary(release))
    return path


@pytest.mark.parametrize("turns", [(0, 0), (1, 0), (0, -1), (-2, 1)])
def test_each_rod_lies_within_half_a_turn_of_the_pose_however_it_was_raised(tmp_path, turns):
    theta = np.array([[0.0, 0.11, 0.09], [0.0, 0.12, 0.08], [0.0, 0.2, 7.0]])
    raised = theta + 2 * np.pi * np.array([0, *turns])
    run = load_run(record(tmp_path / "a.mcap", raised))
    np.testing.assert_allclose(run.theta, theta, atol=2 * np.pi / 16384)


def test_the_turns_are_counted_at_the_release_not_at_the_first_sample(tmp_path):
    theta = np.array([[0.0, 0.1 + np.pi * k / 50, 0.1] for k in range(101)])
    run = load_run(record(tmp_path / "a.mcap", theta, release=100))
    assert run.theta[100, 1] == pytest.approx(0.1, abs=1e-3)
    assert run.theta[0, 1] == pytest.approx(0.1 - 2 * np.pi, abs=1e-3)


def test_the_release_comes_from_the_event_when_the_summary_has_none(tmp_path):
    theta = np.full((5, 3), 0.1)
    run = load_run(record(tmp_path / "a.mcap", theta, summary=RunSummary(), events=[("INDEX", 1), (RELEASED, 3)]))
    np.testing.assert_allclose(run.t, [-0.003, -0.002, -0.001, 0, 0.001])


def test_a_run_without_release_or_samples_is_refused(tmp_path):
    theta = np.full((5, 3), 0.1)
    with pytest.raises(RunError, match="has no release"):
        load_run(record(tmp_path / "a.mcap", theta, summary=RunSummary()))
    with pytest.raises(RunError, match="contains no samples"):
        load_run(record(tmp_path / "b.mcap", theta[:0]))
    with pytest.raises(RunError, match="ends at tick 4, before the release at tick 9"):
        load_run(record(tmp_path / "c.mcap", theta, release=9))


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"rig": {"name": "other"}}, "another rig: paper, not other. Give the rig file"),
        (
            {"encoders": {"counts_per_rev": [16384, 4096, 16384]}},
            "encoders.counts_per_rev is (16384, 16384, 16384) in the run, (16384, 4096, 16384) in the rig file",
        ),
        ({"encoders": {"joint2": "absolute"}}, "encoders.joint2"),
        ({"encoders": {"direction": [1, 1, -1]}}, "encoders.direction"),
    ],
)
def test_a_run_of_another_rig_is_refused(tmp_path, tables, message):
    path = record(tmp_path / "a.mcap", np.full((5, 3), 0.1))
    with pytest.raises(RunError, match="run of another rig: ") as caught:
        load_run(path, changed(**tables))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("source", "remedy"),
    [("device", "record again with this rig file"), ("import", "import the table again with this rig file")],
)
def test_a_run_of_other_encoders_has_a_remedy(tmp_path, source, remedy):
    path = record(tmp_path / "a.mcap", np.full((5, 3), 0.1), source=source)
    with pytest.raises(RunError, match=remedy):
        load_run(path, changed(encoders={"joint2": "absolute"}))


def test_a_corrected_rig_file_is_used_and_its_differences_are_noted(tmp_path):
    path = record(tmp_path / "a.mcap", np.full((5, 3), 0.1))
    values = RIG.model_dump(mode="json", exclude_none=True)["parameters"]
    values["m1"] |= {"measured": 0.12, "std": 0.001}
    run = load_run(path, changed(rig={"L1": 0.39}, parameters=values))
    assert run.notes == (
        "uses the corrected description of the rig: rig.L1 = 0.39 (in the run: 0.4), parameters.m1.measured = 0.12 (in"
        " the run: none), parameters.m1.std = 0.001 (in the run: none)",
    )
    assert not load_run(path, RIG).notes


def test_a_corrected_added_mass_is_used_in_a_corrected_copy(tmp_path):
    values = RIG.model_dump(mode="json", exclude_none=True)
    mass = {"rod": "outer", "position": 0.2}
    wrong, right = (Rig.model_validate({**values, "added_mass": {**mass, "mass": m}}) for m in (1.0, 2.0))
    path = record(tmp_path / "a.mcap", np.full((5, 3), 0.1), rig=wrong)
    (note,) = load_run(path, right).notes
    assert note.startswith(
        "ignored in the rig file, taken from the recording: added_mass.mass = 2.0 (in the run: 1.0);"
    )
    recover(path, tmp_path / "b.mcap", right)
    assert load_run(tmp_path / "b.mcap", right).added_mass == right.added_mass
    with pytest.raises(RunError, match="run of another rig"):
        recover(path, tmp_path / "c.mcap", changed(encoders={"direction": [1, 1, -1]}))
    with pytest.raises(RunError, match="pose X2, which the rig file does not contain"):
        recover(path, tmp_path / "c.mcap", Rig.model_validate({**values, "poses": {}}))


def test_every_other_value_is_noted_as_used_or_as_ignored(tmp_path):
    path, values = record(tmp_path / "a.mcap", np.full((5, 3), 0.1)), RIG.model_dump(mode="json", exclude_none=True)
    values["parameters"]["l1"]["upper"] = 0.3
    values["motor"] = {"input": "torque"}
    values["encoders"] = {"zero_counts": [1, 2, 3]}
    values |= {"rods": {"elbow": "clamped"}, "added_mass": {"rod": "inner", "mass": 1.0, "position": 0.2}}
    values |= {"arm": {"mode": "prescribed"}, "link": {"rate_hz": 500}}
    used, ignored = load_run(path, Rig.model_validate(values)).notes
    assert used.startswith("uses the corrected description of the rig: parameters.l1.upper = 0.3 (in the run: 0.24), ")
    assert "motor.input = torque (in the run: none)" in used
    keys = ("encoders.zero_counts", "added_mass.rod", "added_mass.mass", "rods.elbow", "arm.mode")
    assert [key for key in keys if f"{key} = " in ignored and f"{key} = " not in used] == [*keys]
    assert "link" not in used + ignored


def test_a_copy_that_the_corrected_rig_cannot_describe_is_not_written(tmp_path):
    metadata = RunMetadata(RIG, None, 100, "import", time_source="table", extra={"arm": "clamped"})
    t = np.arange(200) / 100
    with RunWriter(tmp_path / "a.mcap", metadata) as writer:
        writer.table(t, np.column_stack([0 * t, np.cos(3 * t), np.cos(5 * t)]))
        writer.finish(RunSummary(release_tick=0))
    rig = changed(encoders={"zero_counts": [1, 2, 3]}, arm={"mode": "prescribed"})
    with pytest.raises(RunError, match=r"another zero_counts or arm.mode in .* no effect .*: import the table again"):
        recover(tmp_path / "a.mcap", tmp_path / "b.mcap", rig)
    with pytest.raises(RunError, match=r"only the inner rod is mounted. If both .* \[rods\] in the rig file"):
        recover(tmp_path / "a.mcap", tmp_path / "b.mcap", RIG.with_rods("inner"))
    assert not [*tmp_path.glob("b*")]


def test_other_bounds_or_a_new_zero_are_the_same_rig(tmp_path):
    path = record(tmp_path / "a.mcap", np.full((5, 3), 0.1))
    values = RIG.model_dump(mode="json", exclude_none=True)["parameters"]
    values["l1"]["upper"] = 0.3
    rig = changed(parameters=values, encoders={"zero_counts": [1, 2, 3], "noise_counts": 2.0})
    np.testing.assert_array_equal(load_run(path, rig).theta, load_run(path).theta)


@pytest.mark.slow
@given(st.dictionaries(st.text(), st.text()), st.text(), st.text())
def test_a_sealed_record_opens_unchanged_and_only_unchanged(record, key, value):
    record.pop("digest", None)
    closed = sealed(record)
    assert unsealed(closed) == record
    if key != "digest" and record.get(key) != value:
        assert unsealed({**closed, key: value}) is None
