"""Recordings of many kinds of file become the same run; what cannot be one is refused in a sentence."""

import pickle
import sqlite3
import struct
import tracemalloc
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from dpr_lab.errors import RunError
from dpr_lab.rig import load_rig
from dpr_lab.rig_tables import Rods
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.export import JOINT_STATE, JOINT_STATE_DEFINITION, export
from dpr_lab.storage.readers.matlab import read_matlab
from dpr_lab.storage.tables import table as table_module
from dpr_lab.storage.tables.preview import preview
from dpr_lab.storage.tables.table import TableLimits

RIG = load_rig("paper")
N = 200
T = np.round(np.arange(N) * 0.005, 6)
THETA1 = np.pi + 0.8 * np.cos(6 * T)
THETA2 = np.pi + 2.0 * np.cos(4 * T)
SWING = {"t": T, "theta1": THETA1, "theta2": THETA2}
GUESSED: dict[str, Any] = {"unit": None, "time_unit": None}


def read(path: Path, **options: Any) -> Run:
    return import_csv(path, RIG, ImportOptions(**GUESSED | options))


def is_the_swing(run: Run, atol: float = 1e-9) -> bool:
    theta = np.column_stack([0 * T, THETA1, THETA2])
    return bool(np.allclose(run.t, T, rtol=0, atol=1e-9) and np.allclose(run.theta, theta, rtol=0, atol=atol))


def text(path: Path, rows: np.ndarray, delimiter: str = ",", head: str = "", comma: bool = False) -> Path:
    body = "\n".join(delimiter.join(f"{value:.12g}" for value in row) for row in rows)
    path.write_text(head + (body.replace(".", ",") if comma else body) + "\n", encoding="utf-8")
    return path


ROWS = np.column_stack([T, THETA1, THETA2])


def test_text_in_any_form(tmp_path: Path) -> None:
    assert is_the_swing(read(text(tmp_path / "a.tsv", ROWS, "\t", "time [s]\tq1 (rad)\tq2 (rad)\n")))
    assert is_the_swing(read(text(tmp_path / "b.txt", ROWS, " ")))
    named = {"t": "Zeit", "theta1": "innen", "theta2": "außen"}
    german = text(tmp_path / "c.csv", ROWS, ";", "Zeit;innen;außen\n", comma=True)
    assert is_the_swing(read(german, columns=named))
    assert is_the_swing(read(text(tmp_path / "d.txt", ROWS, "\t", comma=True)))
    in_degrees = np.column_stack([T * 1e3, np.degrees(ROWS[:, 1:])])
    assert is_the_swing(read(text(tmp_path / "e.csv", in_degrees, head="time_ms,theta1_deg,theta2 [°]\n")))
    run = read(text(tmp_path / "f.txt", ROWS))
    assert run.notes == ("columns without names are interpreted as t, theta1, theta2",)


def write_mat(path: Path, **held: Any) -> Path:
    savemat(path, held, do_compression=True)
    return path


def write_h5(path: Path, prefix: bytes = b"", **held: np.ndarray) -> Path:
    import h5py

    with h5py.File(path, "w", userblock_size=512 if prefix else 0) as file:
        for name, array in held.items():
            file[name] = array
    if prefix:
        with path.open("r+b") as file:
            file.write(prefix)
    return path


def write_npz(path: Path, **held: np.ndarray) -> Path:
    np.savez_compressed(path, **held)
    return path


def write_parquet(path: Path, **held: np.ndarray) -> Path:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table(held), path)
    return path


WRITERS = {".mat": write_mat, ".h5": write_h5, ".npz": write_npz, ".parquet": write_parquet}


@pytest.mark.parametrize("suffix", WRITERS)
def test_named_arrays(tmp_path: Path, suffix: str) -> None:
    assert is_the_swing(read(WRITERS[suffix](tmp_path / f"a{suffix}", **SWING)))


@pytest.mark.parametrize("suffix", [".mat", ".h5", ".npz"])
def test_a_matrix_beside_scalars_words_and_tables_of_something_else(tmp_path: Path, suffix: str) -> None:
    file = WRITERS[suffix](tmp_path / f"a{suffix}", data=ROWS, fs=np.array(200.0), other=np.arange(7.0))
    assert is_the_swing(read(file, take=("data",)))
    assert is_the_swing(read(file))
    with pytest.raises(RunError, match="contains nothing named 'date'; it contains: data, fs, other"):
        read(file, take=("date",))


def test_a_struct_with_time_and_matlab_version_7_3(tmp_path: Path) -> None:
    simulink = {"time": T, "signals": {"values": ROWS[:, 1:], "dimensions": 2.0, "label": "theta"}}
    assert is_the_swing(read(write_mat(tmp_path / "a.mat", out=simulink)))
    twice = write_mat(tmp_path / "b.mat", first=SWING, second={**SWING, "theta1": THETA1 + 1})
    assert is_the_swing(read(twice, take=("first",)))
    with pytest.raises(RunError, match="no single column found for t and theta1 and theta2; the table has: first/t"):
        read(twice)
    flat = {name: column[None, :] for name, column in SWING.items()}
    newer = write_h5(tmp_path / "c.mat", b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(128), **flat)
    assert is_the_swing(read(newer))


def mat_element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def mat_file(path: Path, *elements: bytes) -> Path:
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(elements))
    return path


def test_an_object_of_matlab_says_how_to_save_it(tmp_path: Path) -> None:
    names = [mat_element(1, name) for name in (b"ts", b"MCOS", b"timeseries")]
    flags, ids = mat_element(6, struct.pack("<II", 17, 0)), mat_element(6, struct.pack("<II", 6, 0))
    shape, empty = mat_element(5, struct.pack("<ii", 1, 1)), mat_element(1, b"")
    data = mat_element(14, ids + shape + empty + mat_element(9, struct.pack("<d", 0.0)))
    opaque = mat_element(14, flags + b"".join(names) + data)
    with pytest.raises(RunError, match=r"MATLAB class timeseries, .* save it as a struct: s.time = ts.Time"):
        read(mat_file(tmp_path / "a.mat", opaque))


def test_what_unpacks_to_more_than_a_recording_is_refused_unread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_module, "LIMITS", TableLimits(values=100_000))
    zeros = np.zeros(200_000)
    for suffix, write in WRITERS.items():
        file = write(tmp_path / f"a{suffix}", t=zeros, theta1=zeros)
        assert suffix == ".h5" or file.stat().st_size < 20_000
        with pytest.raises(RunError, match="more than 100,000: cut it into recordings"):
            read(file)
    bomb = mat_element(15, zlib.compress(bytes(10_000_000), 9))
    with pytest.raises(RunError, match="cut it into recordings"):
        read(mat_file(tmp_path / "b.mat", bomb))


def test_a_pickle_in_an_array_is_not_loaded(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", t=np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(RunError, match="pickled objects, which could contain code"):
        read(tmp_path / "a.npz")
    (tmp_path / "b.npy").write_bytes(pickle.dumps([1]))
    with pytest.raises(RunError):
        read(tmp_path / "b.npy")


def damaged(path: Path) -> list[Path]:
    """The file cut short, and with bytes changed."""
    content = path.read_bytes()
    found = []
    rng = np.random.default_rng(5)
    for number in range(12):
        changed = bytearray(content if number else content[: len(content) // 2])
        for at in rng.integers(0, len(changed), 30 if number else 0):
            changed[at] = int(rng.integers(256))
        found.append(path.with_name(f"{number}{path.suffix}"))
        found[-1].write_bytes(changed)
    return found


@pytest.mark.parametrize("suffix", [*WRITERS, ".mcap", ".db3"])
def test_a_damaged_file_is_a_sentence(tmp_path: Path, suffix: str) -> None:
    whole = tmp_path / f"whole{suffix}"
    if suffix in WRITERS:
        WRITERS[suffix](whole, **SWING)
    else:
        BAGS[suffix](whole, [("/joint_states", ("theta1", "theta2"), ROWS)])
    for file in damaged(whole):
        try:
            read(file)
        except RunError as error:
            assert str(file) in str(error)  # noqa: PT017


@pytest.mark.parametrize("suffix", WRITERS)
def test_columns_of_different_length_are_named(tmp_path: Path, suffix: str) -> None:
    if suffix == ".parquet":
        return  # cannot hold them
    file = WRITERS[suffix](tmp_path / f"a{suffix}", **SWING | {"theta2": THETA2[:-1]})
    with pytest.raises(RunError, match="columns of different length: theta2 199 values, but the others have 200"):
        read(file)


def test_what_is_no_table_at_all(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.xlsx", "w") as archive:
        archive.writestr("xl/workbook.xml", "<workbook/>")
    with pytest.raises(RunError, match="save the table of a spreadsheet as CSV"):
        read(tmp_path / "a.xlsx")
    with pytest.raises(RunError, match="contains no columns of numbers; it contains: name"):
        read(write_mat(tmp_path / "b.mat", name="swing"))
    with pytest.raises(RunError, match=r"without metadata.yaml and thus not a ROS 2 bag"):
        read(tmp_path)
    long = text(tmp_path / "c.csv", ROWS, head="t,theta1,theta2\n")
    long.write_text(long.read_text() + f"9,{'9' * 5000},1\n")
    assert any("outliers removed: 1" in note or "without a value" in note for note in read(long).notes)


Topic = tuple[str, tuple[str, ...], np.ndarray]


def write_mcap(path: Path, topics: list[Topic], stamped: bool = True) -> Path:
    from mcap_ros2.writer import Writer

    with path.open("wb") as file, Writer(file) as writer:
        schema = writer.register_msgdef(JOINT_STATE, JOINT_STATE_DEFINITION)
        other = writer.register_msgdef("std_msgs/msg/String", "string data")
        writer.write_message("/chatter", other, {"data": "hello"}, 1)
        for topic, names, rows in topics:
            for row in rows:
                ns = round(row[0] * 1e9) + 1_700_000_000_000_000_000
                message = joint_state(ns if stamped else 0, names, row[1:])
                writer.write_message(topic, schema, message, ns + 1000 * (not stamped), ns)
    return path


def joint_state(ns: int, names: tuple[str, ...], position: np.ndarray) -> dict[str, Any]:
    stamp = {"sec": ns // 10**9, "nanosec": ns % 10**9}
    header = {"stamp": stamp, "frame_id": "base"}
    return {"header": header, "name": list(names), "position": list(position), "velocity": [], "effort": []}


def write_db3(path: Path, topics: list[Topic]) -> Path:
    from mcap_ros2._dynamic import serialize_dynamic

    encode = serialize_dynamic(JOINT_STATE, JOINT_STATE_DEFINITION)[JOINT_STATE]
    bag = sqlite3.connect(path)
    bag.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    bag.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    for number, (topic, names, rows) in enumerate(topics):
        bag.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr')", (number, topic, JOINT_STATE))
        messages = [(number, round(row[0] * 1e9) + 10**18, encode(joint_state(0, names, row[1:]))) for row in rows]
        bag.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", messages)
    bag.commit()
    bag.close()
    return path


BAGS = {".mcap": write_mcap, ".db3": write_db3}


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
    with pytest.raises(RunError, match="the table has: t, elbow, gripper, shoulder"):
        read(one)


@pytest.mark.parametrize("suffix", BAGS)
def test_bags_that_cannot_be_understood(tmp_path: Path, suffix: str) -> None:
    joints = ("theta1", "theta2")
    write = BAGS[suffix]
    two = write(tmp_path / f"two{suffix}", [("/a", joints, ROWS), ("/b", joints, ROWS + 0.1)])
    with pytest.raises(RunError, match="on several topics: choose one with --take: /a, /b"):
        read(two)
    assert is_the_swing(read(two, take=("/a",)))
    for topics, said in (
        ([], "contains no sensor_msgs/JointState"),
        ([("/a", ("theta1", "theta1"), ROWS)], "two joints with the same name in a JointState: theta1, theta1"),
        ([("/a", ("theta1", "theta2", "tip"), ROWS)], "a JointState of 3 names and 2 positions"),
    ):
        with pytest.raises(RunError, match=said):
            read(write(tmp_path / f"{len(said)}{suffix}", topics))


def test_a_run_is_exported_as_joint_states_and_comes_back(tmp_path: Path) -> None:
    run = import_csv(text(tmp_path / "a.csv", ROWS, head="t,theta1,theta2\n"), RIG, out=tmp_path / "run.mcap")
    bag = export(run, tmp_path / "b.mcap")
    assert is_the_swing(read(bag))
    with pytest.raises(RunError, match="is already a run of dpr-lab"):
        read(tmp_path / "run.mcap")
    unstamped = write_mcap(tmp_path / "c.mcap", [("/joint_states", ("theta1", "theta2"), ROWS)], stamped=False)
    assert is_the_swing(read(unstamped))


PIVOT, L1, L2 = np.array([310.0, 240.0]), 180.0, 120.0
RNG = np.random.default_rng(7)
ELBOW = PIVOT + L1 * np.column_stack([-np.sin(THETA1), np.cos(THETA1)])
TIP = ELBOW + L2 * np.column_stack([-np.sin(THETA2), np.cos(THETA2)])


def pixels(up: float = 1.0, noise: float = 0.0) -> list[np.ndarray]:
    seen = [np.broadcast_to(PIVOT, ELBOW.shape), ELBOW, TIP]
    return [(points + RNG.normal(0, noise, points.shape)) * (1, up) for points in seen]


def test_points_of_tracker(tmp_path: Path) -> None:
    _, elbow, tip = pixels()
    rows = np.column_stack([T, elbow, tip])
    head = "#multi:\n\tmass A\t\tmass B\t\t\nt\tx\ty\tx\ty\t\n"
    file = text(tmp_path / "a.txt", rows, "\t", head)
    run = read(file)
    assert is_the_swing(run, atol=1e-6)
    assert any("pivot (centre of the elbow's circle), elbow mass A, tip mass B" in note for note in run.notes)
    with pytest.raises(RunError, match="angles from points are absolute"):
        read(file, zero="hanging")


def test_points_of_deeplabcut_and_their_noise(tmp_path: Path) -> None:
    points = pixels(up=-1.0, noise=0.5)
    certain = np.ones(N)
    certain[40:43] = 0.1
    points[1][40:43] += 300
    columns = [column for point in points for column in (*point.T, certain)]
    names = ["pivot", "elbow", "tip"]
    scorer = "scorer," + ",".join(["DLC_resnet50"] * 9)
    parts = "bodyparts," + ",".join(name for name in names for _ in range(3))
    head = f"{scorer}\n{parts}\ncoords," + ",".join(["x", "y", "likelihood"] * 3) + "\n"
    file = text(tmp_path / "a.csv", np.column_stack([np.arange(N), *columns]), head=head)
    with pytest.raises(RunError, match="for a table without time give --rate-hz"):
        read(file)
    run = read(file, rate_hz=200.0)
    kept = np.delete(np.arange(N), [40, 41, 42])
    np.testing.assert_allclose(run.theta[:, 1], THETA1[kept], atol=5 * 0.5 / L1)
    noise = [float(note.split("noise ")[1].split()[0]) for note in run.notes if "noise" in note]
    assert noise == pytest.approx([0.5 / L1, 0.5 * np.sqrt(2) / L2], rel=0.3)
    with pytest.raises(RunError, match=r"changes its length by .* these points are not its ends"):
        read(file, rate_hz=200.0, take=("pivot", "tip", "elbow"))


def test_columns_of_x_and_y_are_points_too(tmp_path: Path) -> None:
    rows = np.column_stack([T, *pixels(up=-1.0)])
    file = text(tmp_path / "a.csv", rows, head="t_s,x0_px,y0_px,x1_px,y1_px,x2_px,y2_px\n")
    assert is_the_swing(read(file), atol=1e-6)


def test_scale_offset_and_wrap(tmp_path: Path) -> None:
    turned = np.column_stack([T, 90 - np.degrees(THETA1), (np.degrees(THETA2) * 2) % 360])
    file = text(tmp_path / "a.csv", turned, head="t,theta1,theta2\n")
    options = {"scale": {"theta1": -1.0, "theta2": 0.5}, "offset": {"theta1": 90.0}, "wrap": 360.0}
    run = read(file, unit="deg", **options)
    assert np.allclose(run.theta[:, 1], THETA1)
    assert np.allclose(np.diff(run.theta[:, 2]), np.diff(THETA2))
    whole = np.round(RIG.positions(np.column_stack([0 * T, THETA1, THETA2])))
    counts = np.column_stack([T, whole[:, 1:] % 4096])
    run = read(text(tmp_path / "b.csv", counts, head="t,counts1,counts2\n"), wrap=4096.0)
    assert run.counts is not None
    np.testing.assert_array_equal(np.diff(run.counts, axis=0), np.diff(whole.astype(int), axis=0))


def test_a_preview_says_what_was_understood_and_writes_nothing(tmp_path: Path) -> None:
    file = write_mat(tmp_path / "a.mat", **SWING | {"t": np.where(T > 0.5, T + 0.2, T)})
    found = preview(file, RIG, ImportOptions(**GUESSED))
    facts = found.facts()
    assert facts["columns"] == "t = t, theta1 = theta1, theta2 = theta2"
    assert facts["angles"] == "rad, absolute, upright is 0"
    assert facts["rate"].startswith("200 Hz, steps 0.005 to 0.205 s; 1 gap")
    assert found.first_rows()[0] == pytest.approx((0.0, 0.0, THETA1[0], THETA2[0]))
    assert [path.name for path in tmp_path.iterdir()] == ["a.mat"]
    fast = text(tmp_path / "b.csv", np.column_stack([T, np.degrees(ROWS[:, 1:])]), head="t,theta1,theta2\n")
    asked = [question.sentence for question in preview(fast, RIG, ImportOptions(**GUESSED)).questions]
    assert any("--unit" in sentence for sentence in asked), asked


@pytest.mark.parametrize(
    ("name", "scale"), [("theta_deg", 180 / np.pi), ("angle [rad]", 1.0), ("counts", 16384 / 2 / np.pi)]
)
def test_one_rod_alone_needs_no_number(tmp_path: Path, name: str, scale: float) -> None:
    rig = RIG.model_copy(update={"rods": Rods(mounted="inner")})
    hanging = np.round((THETA1 - np.pi) * scale) if name == "counts" else THETA1 * scale
    file = text(tmp_path / "a.csv", np.column_stack([T, hanging]), head=f"t_s,{name}\n")
    run = import_csv(file, rig, ImportOptions(**GUESSED))
    assert np.allclose(run.theta[:, 1], THETA1, atol=2 * np.pi / 16384)


def test_a_matlab_file_takes_the_memory_of_its_numbers(tmp_path: Path) -> None:
    rows, columns = 100_000, 20
    t = np.arange(rows) / 1000
    filled = {f"x{k}": np.round(np.cos(t + k), 2) for k in range(columns)}
    savemat(tmp_path / "a.mat", {"t": t, "theta1": np.cos(t), "theta2": np.sin(t), **filled}, do_compression=True)
    read_matlab(tmp_path / "a.mat", ())  # SciPy is loaded
    tracemalloc.start()
    try:
        table = read_matlab(tmp_path / "a.mat", ())
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(table.values) == columns + 3
    assert peak < 1.5 * 8 * rows * (columns + 3)
