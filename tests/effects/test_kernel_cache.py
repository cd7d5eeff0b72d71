import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import codegen
from numba.core import config as numba_config

import dpr_lab
from dpr_lab.kernel_cache import KEPT, KERNEL_SOURCES, PRUNE_AFTER_S, choose_cache, open_cache, prune, source_hash
from dpr_lab.kernels import _loops_kept

PACKAGE = Path(dpr_lab.__file__).parent

SWING = """
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.effects import effect_params
vector = effect_params({"coulomb_joint1": {"torque_Nm": 2e-3}})
base = [0.05, 0.005, 0.008, 1.4, 0.001, 0.001]
print(repr(float(simulate(base, 0.4, 9.81, [1, 2, 0, 0], [0, 0.5], 1e-3, vector)[-1, 0])))
"""


COMPILED = """
from numba.core import event
class Compiled(event.Listener):
    def on_start(self, event):
        if event.data["name"].startswith("translate_bytecode"):
            print("compiled", event.data["qualname"])
    def on_end(self, event):
        pass
event.register("numba:run_pass", Compiled())
"""


@pytest.fixture
def copy(tmp_path):
    target = tmp_path / "tree" / "dpr_lab"
    shutil.copytree(PACKAGE, target, ignore=shutil.ignore_patterns("__pycache__"))
    return target


def test_every_file_that_compiles_is_hashed():
    hashed = {file for source in KERNEL_SOURCES for file in [PACKAGE / source, *(PACKAGE / source).rglob("*.py")]}
    compiling = {file for file in PACKAGE.rglob("*.py") if "@njit" in file.read_text() or "@numba" in file.read_text()}
    assert compiling <= hashed


@pytest.mark.parametrize("source", ["effects/coulomb.py", "dynamics/equation.py", "kernels.py"])
def test_hash_changes_with_any_source(copy, source):
    before = source_hash(copy)
    assert before == source_hash(PACKAGE)
    with (copy / source).open("a") as file:
        file.write("\nEDITED = 1\n")
    assert source_hash(copy) != before


@pytest.mark.long
def test_an_edited_effect_changes_the_answer_of_a_cached_caller(copy, tmp_path):
    # Numba alone keeps the old machine code of `simulate` here, because only the file of a called function changed.
    def swing():
        environment = {**os.environ, "PYTHONPATH": str(copy.parent), "XDG_CACHE_HOME": str(tmp_path / "cache")}
        environment.pop("NUMBA_CACHE_DIR", None)
        run = subprocess.run(
            [sys.executable, "-c", SWING], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
        )
        return float(run.stdout)

    first = swing()
    compiled = sorted((tmp_path / "cache").rglob("*.nbc"))
    assert compiled
    assert swing() == first
    assert sorted((tmp_path / "cache").rglob("*.nbc")) == compiled
    coulomb = copy / "effects" / "coulomb.py"
    written = coulomb.read_text()
    edited = written.replace("return -torque_Nm * ", "return -5.0 * torque_Nm * ")
    assert edited != written
    coulomb.write_text(edited)
    assert abs(swing() - first) > 1e-3


LOADED = """
import sys
import numpy as np
import dpr_lab.gap.diagnose
from dpr_lab.gap.screen.local_faults import local_faults
from dpr_lab.dynamics.prediction import predict
from dpr_lab.effects import effect_params
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.rig import load_rig
rig = load_rig("paper")
base = base_parameters(rig.nominal, rig.L1, rig.g)
predict(base, effect_params({}), rig_constants(rig), segments([[0.0, 0.1]]), [[3.0, 3.0, 0.0, 0.0]])
t = 1e-3 * np.arange(500)
local_faults(t, np.sin(t), np.ones(500, dtype=bool), (1e-4, 0.0), 1e-3)
print([name for name in ("scipy.linalg", "scipy.special", "scipy.optimize") if name in sys.modules])
"""


@pytest.mark.slow
def test_a_second_start_compiles_nothing_and_loads_nothing_that_a_compilation_imports():
    # What holds the arm was compiled in every process, by functions that are written from the table and have no file.
    # What a compilation imports takes longer to import than every kernel of a diagnosis takes to load. The screening of
    # readings without a gap does not need SciPy either.
    for _ in range(2):  # the first start may compile
        command = [sys.executable, "-c", COMPILED + LOADED + SWING]
        modules, *others = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
        if (modules, len(others)) == ("[]", 1):
            break
    assert modules == "[]"
    assert len(others) == 1  # the angle


def test_without_a_writable_folder_there_is_no_cache(tmp_path):
    (tmp_path / "file").touch()
    assert open_cache(tmp_path / "file", "hash") is None


def test_old_cache_folders_are_deleted_and_recent_ones_kept(tmp_path):
    now = 1e9
    ages = [0.0, 1.0, 2.0, PRUNE_AFTER_S / 2, PRUNE_AFTER_S + 1, 2 * PRUNE_AFTER_S]
    for age in ages:
        folder = tmp_path / f"{age}"
        folder.mkdir()
        os.utime(folder, (now - age, now - age))
    prune(tmp_path, now)
    assert {folder.name for folder in tmp_path.iterdir()} == {f"{age}" for age in ages[:KEPT]}


def test_recent_cache_folders_are_kept_however_many(tmp_path):
    for i in range(KEPT + 3):
        (tmp_path / str(i)).mkdir()
    prune(tmp_path, os.stat(tmp_path).st_mtime)
    assert len(list(tmp_path.iterdir())) == KEPT + 3


def test_the_cache_of_other_numba_programs_keeps_its_folder():
    assert "dpr-lab" not in str(numba_config.CACHE_DIR)  # pyright: ignore[reportAttributeAccessIssue]


def test_a_version_of_numba_without_the_changed_names_compiles_as_usual(monkeypatch):
    monkeypatch.setattr(codegen, "create_pass_builder", lambda machine: machine)
    with _loops_kept():
        assert codegen.create_pass_builder("builder") == "builder"
    monkeypatch.delattr(codegen, "create_pass_builder")
    with _loops_kept():
        assert not hasattr(codegen, "create_pass_builder")


FULL_DISK = """
import resource, signal, sys
import dpr_lab.kernel_cache
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
sys.dont_write_bytecode = True  # a module file of the limited size would be damaged for all later tests
resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))
from dpr_lab.kernels import behind_pointer, njit
@njit
def twice(x):
    return 2 * x
def nothing(x):
    pass
behind_pointer(nothing, 1.0)
print(twice(21))
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="limits the size of files")
def test_a_full_disk_loses_the_cache_but_not_the_result(tmp_path):
    (tmp_path / "program.py").write_text(FULL_DISK)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    run = subprocess.run([sys.executable, tmp_path / "program.py"], env=environment, capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (0, "42\n"), run.stderr
    assert not list((tmp_path / "cache").rglob("*.nbc"))


KERNELS = """
from dpr_lab.kernels import behind_pointer, njit
@njit
def twice(x):
    return 2 * x
@njit
def thrice(x):
    return 3 * x
def nothing(x):
    pass
def ignored(x):
    pass
behind_pointer(nothing, 1.0)
behind_pointer(ignored, 1.0)
print(twice(21), thrice(14))
"""


def run_kernels(folder, cache):
    """Names of the kernels that a new process compiles."""
    (folder / "program.py").write_text(COMPILED + KERNELS)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    run = subprocess.run([sys.executable, folder / "program.py"], env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    *compiled, answer = run.stdout.splitlines()
    assert answer == "42 42"
    return {line.split()[-1] for line in compiled if "numba" not in line}


CUT = {"twice": (".nbi", 0.0), "thrice": (".nbc", 0.0), "nothing": (".nbi", 0.5), "ignored": (".nbc", 0.5)}
"""For each kernel, the truncated file and the share of the file that is kept."""


@pytest.mark.slow
def test_kernels_whose_cache_was_cut_off_are_compiled_again(tmp_path):
    cache = tmp_path / "cache"
    assert run_kernels(tmp_path, cache) == CUT.keys()
    for kernel, (suffix, kept) in CUT.items():
        (file,) = cache.rglob(f"*.{kernel}-*{suffix}")
        os.truncate(file, int(kept * file.stat().st_size))
    assert run_kernels(tmp_path, cache) == CUT.keys()
    assert not run_kernels(tmp_path, cache)


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="folders with owners as POSIX has them")
def test_a_cache_that_others_could_write_is_emptied_and_closed(tmp_path):
    for opened in ("root", "root/hash"):
        folder = tmp_path / "root" / "hash"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "planted.nbi").touch()
        (tmp_path / opened).chmod(0o777)
        assert open_cache(tmp_path / "root", "hash") == folder
        assert not list(folder.iterdir())
        assert not folder.stat().st_mode & 0o022
        assert not folder.parent.stat().st_mode & 0o022


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can give a folder away")
@pytest.mark.parametrize("given", ["root", "root/hash"])
def test_a_cache_of_another_user_is_replaced_by_a_private_one(tmp_path, given):
    (tmp_path / "root" / "hash").mkdir(parents=True)
    os.chown(tmp_path / given, 12345, 12345)
    cache, why = choose_cache([tmp_path / "root", tmp_path / "own"], "hash")
    assert cache == tmp_path / "own" / "hash"
    assert (
        why == f"{tmp_path / given}: belongs to another user, so its compiled kernels are not loaded,"
        f" because they could contain malicious code"
    )
    assert choose_cache([tmp_path / "own"], "hash") == (cache, "")
    assert choose_cache([tmp_path / "root"], "hash")[0] is None
