"""ROS 2 bags: joint states as a recording, and a run as joint states."""

import sys
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.export import export
from tests.storage.swing_files import BAGS, RIG, ROWS, THETA1, THETA2, T, is_the_swing, read, text, write_mcap


@pytest.mark.slow
@pytest.mark.parametrize("suffix", BAGS)
def test_joint_states_of_a_bag(tmp_path: Path, suffix: str) -> None:
    joints = ("elbow", "gripper", "shoulder")
    rows = np.column_stack([T, THETA2, 0 * T, THETA1])
    named = {"theta1": "shoulder", "theta2": "elbow"}
    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    for number, part in enumerate(np.array_split(rows, 11)):
        BAGS[suffix](folder / f"bag_{number}{suffix}", [("/joint_states", joints, part)])
    assert is_the_swing(read(folder, columns=named))
    one = BAGS[suffix](tmp_path / f"one{suffix}", [("/joint_states", joints, rows)])
    run = read(one, columns=named)
    assert is_the_swing(run)
    assert "joints of /joint_states: elbow, gripper, shoulder" in run.notes
    assert is_the_swing(read(one))
    other = BAGS[suffix](tmp_path / f"other{suffix}", [("/joint_states", ("a", "b", "c"), rows)])
    with pytest.raises(RunError, match="the table has: t, a, b, c"):
        read(other)


@pytest.mark.parametrize("suffix", BAGS)
def test_bags_that_cannot_be_understood(tmp_path: Path, suffix: str) -> None:
    joints = ("theta1", "theta2")
    write = BAGS[suffix]
    two = write(tmp_path / f"two{suffix}", [("/a", joints, ROWS), ("/b", joints, ROWS + 0.1)])
    with pytest.raises(RunError, match="on several topics: choose one with --take: /a, /b"):
        read(two)
    assert is_the_swing(read(two, take=("/a",)))
    for topics, result in (
        ([], "contains no sensor_msgs/JointState"),
        ([("/a", ("theta1", "theta1"), ROWS)], "two joints of a JointState have the same name: theta1, theta1"),
        ([("/a", ("theta1", "theta2", "tip"), ROWS)], "a JointState with 3 names but 2 positions"),
    ):
        with pytest.raises(RunError, match=result):
            read(write(tmp_path / f"{len(result)}{suffix}", topics))


@pytest.mark.parametrize("suffix", BAGS)
def test_a_damaged_file_of_a_bag_is_named(tmp_path: Path, suffix: str) -> None:
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    BAGS[suffix](tmp_path / f"bag_0{suffix}", [("/joint_states", ("theta1", "theta2"), ROWS)])
    (tmp_path / f"bag_1{suffix}").write_bytes(b"no recording" * 100)
    with pytest.raises(RunError, match=rf"bag_1\{suffix}: is damaged or incomplete, or is not a ROS 2 bag"):
        read(tmp_path)


def test_a_run_is_recognised_without_the_library_of_ros(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mcap_ros2.decoder", None)
    import_csv(text(tmp_path / "a.csv", ROWS, head="t,theta1,theta2\n"), RIG, out=tmp_path / "run.mcap")
    with pytest.raises(RunError, match="is already a run of dpr-lab"):
        read(tmp_path / "run.mcap")


@pytest.mark.slow
def test_a_run_is_exported_as_joint_states_and_comes_back(tmp_path: Path) -> None:
    run = import_csv(text(tmp_path / "a.csv", ROWS, head="t,theta1,theta2\n"), RIG, out=tmp_path / "run.mcap")
    bag = export(run, tmp_path / "b.mcap")
    assert is_the_swing(read(bag))
    with pytest.raises(RunError, match="is already a run of dpr-lab"):
        read(tmp_path / "run.mcap")
    unstamped = write_mcap(tmp_path / "c.mcap", [("/joint_states", ("theta1", "theta2"), ROWS)], stamped=False)
    assert is_the_swing(read(unstamped))
