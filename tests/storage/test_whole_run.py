"""Imported runs get their final name and their hash file only when they are complete."""

import os
import time

import pytest

from dpr_lab.configs import sha256_of
from dpr_lab.errors import RunError
from dpr_lab.rig import load_rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.inspect import verify
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.sidecar import read_sidecar, write_sidecar
from dpr_lab.storage.whole_run import whole_run
from tests.warm_process import started

RIG = load_rig("paper")

KILLED = """
import os, signal, sys
from dpr_lab.rig import load_rig
from dpr_lab.storage.csv_import import import_csv
from dpr_lab.storage.writer import RunWriter
table = RunWriter.table
def cut(self, *rows):
    table(self, *rows)
    self.flush()
    os.kill(os.getpid(), signal.SIGKILL)
RunWriter.table = cut
import_csv(sys.argv[1], load_rig("paper"), out=sys.argv[2])
"""


AT_THE_LINK = """
import os, signal, sys
from dpr_lab.rig import load_rig
from dpr_lab.storage.csv_import import import_csv
link = os.link
def cut(*paths):
    if sys.argv[3] == "after":
        link(*paths)
    os.kill(os.getpid(), signal.SIGKILL)
os.link = cut
import_csv(sys.argv[1], load_rig("paper"), out=sys.argv[2])
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kills a process")
@pytest.mark.parametrize(("when", "left"), [("before", set()), ("after", {"swing.mcap"})])
def test_an_import_that_is_killed_at_its_end_leaves_no_hash_without_its_run(tmp_path, when, left):
    table, out = tmp_path / "swing.csv", tmp_path / "runs" / "swing.mcap"
    table.write_text("t,theta1,theta2\n" + "".join(f"{i / 100},{3 + i / 1000},{3 - i / 1000}\n" for i in range(50)))
    with started("tests.program_text", [AT_THE_LINK, table, out, when]) as killed:
        assert killed.wait() < 0
    assert {path.name for path in out.parent.iterdir() if path.suffix != ".part"} == left
    if left:
        assert load_run(out).complete
        assert verify(out).faults == ["there is no swing.mcap.sha256 in its folder"]
    else:
        import_csv(table, RIG, out=out)
        assert verify(out).ok


def test_the_hash_of_a_run_that_another_process_wrote_meanwhile_is_kept(tmp_path):
    out = tmp_path / "swing.mcap"

    def late():
        with whole_run(out, RunMetadata(RIG, "X2", 1000)) as writer:
            writer.finish(RunSummary())
            out.write_bytes(b"other")
            write_sidecar(out)

    with pytest.raises(RunError, match="exists already"):
        late()
    assert read_sidecar(out) == sha256_of(out)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kills a process")
def test_a_killed_import_leaves_no_file_of_its_name_and_the_next_one_cleans_up(tmp_path):
    rows = "".join(f"{i / 100},{3 + i / 1000},{3 - i / 1000}\n" for i in range(50))
    table, out = tmp_path / "swing.csv", tmp_path / "runs" / "swing.mcap"
    table.write_text(f"t,theta1,theta2\n{rows}")
    with started("tests.program_text", [KILLED, table, out]) as killed:
        assert killed.wait() < 0
    (part,) = out.parent.iterdir()
    assert part.name.startswith("swing.mcap.")
    assert part.suffix == ".part"
    assert part.stat().st_size > 0
    import_csv(table, RIG, out=out)
    assert part.exists()  # it may belong to a living process
    aged = time.time() - 3600
    os.utime(part, (aged, aged))
    import_csv(table, RIG, out=out.with_name("again.mcap"))
    names = {path.name for path in out.parent.iterdir()}
    assert names == {"swing.mcap", "swing.mcap.sha256", "again.mcap", "again.mcap.sha256"}
    assert verify(out).ok
