"""Fixtures that several test packages use."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: tests run side by side

import gc
import shutil
import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from dpr_lab.rig import Rig, load_rig
from dpr_lab.transports.transport import Capacity, Received, Transport
from firmware_protocol.messages import NUMBERS, Frame, Release, Sample

settings.register_profile(
    "repeatable", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow], max_examples=60
)
settings.load_profile("repeatable")

# A shell starts what runs in its background deaf to Ctrl-C, and so would be every program that a test interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)

gc.disable()  # hundreds of thousands of objects of the libraries and of the collected tests are there to stay
gc.set_threshold(50_000, 20, 100)

STOP_TIMEOUT_S = 60.0
DEVICE_STARTS_S = 600.0
"""Time limit for the start of a simulated device on a busy machine, s."""

LIVE = {"acquisition", "cli", "faults", "firmware_c", "sim_device", "transports", "tui"}
"""Folders whose tests talk to running devices. One that fails is repeated once, because a machine may stop for seconds;
the summary lists it as `RERUN`, and it is a bug in the test or in the product."""


def pytest_configure() -> None:
    """Start the process from which commands and simulated devices are forked, before the test processes."""
    import_module("tests.warm_process").start_server()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Let one process compile tests and libraries to bytecode in a fresh clone."""
    with import_module("tests.compiled_once").compiled_once():
        return (yield)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark live and slow tests, compile kernels for all processes, validate written results, and sort the files.

    Fast tests come first. Of the files, those of the screen come first, then those with the longest time limits, then
    those with the most slow tests: no process then works on one of them while the others are finished.
    """
    import_module("tests.one_compiler")
    import_module("tests.valid_files")
    for test in items:
        if LIVE.intersection(test.nodeid.split("/")):
            test.add_marker(pytest.mark.flaky(reruns=1))
        if test.get_closest_marker("long") is not None:
            test.add_marker(pytest.mark.slow)
    limits, slow = dict[Path, float](), Counter[Path]()
    for test in items:
        marker = test.get_closest_marker("timeout")
        limits[test.path] = max(limits.get(test.path, 0.0), marker.args[0] if marker else 0.0)
        slow[test.path] += test.get_closest_marker("slow") is not None
    fast_first = import_module("tests.fast_first")

    def order(test: pytest.Item) -> tuple[bool, bool, float, int]:
        is_slow, of_screen = test.get_closest_marker("slow") is not None, fast_first.is_of_screen(test.nodeid)
        return is_slow, not of_screen, -limits[test.path], -slow[test.path]

    items.sort(key=order)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Distribute the tests of a file to one worker, its slow ones later."""
    return import_module("tests.fast_first").FastFirst(config, log) if config.option.dist == "loadfile" else None


def pytest_collection_finish() -> None:
    """Exclude the loaded objects from garbage collection, which starts now."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def warm_devices() -> Iterator[None]:
    """Fork simulated devices that dpr-lab starts from a process with the libraries loaded."""
    warm, modules = import_module("tests.warm_process"), ("dpr_lab.child_process", "dpr_lab.trials.sealing")
    with pytest.MonkeyPatch.context() as patch:
        for module in map(import_module, modules):
            patch.setattr(module, "subprocess", warm.starts_device(partial(warm.started, "sim_device")))
        simulated = import_module("dpr_lab.transports.simulated")
        patch.setattr(simulated, "PATIENCE", replace(simulated.PATIENCE, start_s=DEVICE_STARTS_S))
        yield


@pytest.fixture(autouse=True)
def signals_as_they_were() -> Iterator[None]:
    """Restore the signal handlers after a command that ran in the process of a test."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, answer in before.items():
        signal.signal(number, answer)


@pytest.fixture
def few_readings(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Fixture (pattern): fast tests then compare only these interpretations of a recording and some others."""
    return partial(import_module("tests.few_readings").compare_few, monkeypatch)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20261121)


@pytest.fixture(scope="session")
def paper() -> Rig:
    return load_rig("paper")


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], None]], Path]:
    """Fixture (name, make): folder that `make` has filled, created once for all test processes."""
    import fcntl

    own = tmp_path_factory.getbasetemp()
    everyone = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own

    def folder_of(name: str, make: Callable[[Path], None]) -> Path:
        folder, done = everyone / name, everyone / f"{name}.done"
        with (everyone / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not done.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                make(folder)
                done.touch()
        return folder

    return folder_of


@pytest.fixture(scope="session")
def recorded(paper: Rig) -> Callable[..., list[Any]]:
    """Fixture (effects, seed, duration, encoders): one run of a simulated rig from each pose.

    The plant integrates ten times finer than the lab.
    """
    from sim_device.plant.config import EncoderConfig, PlantConfig, load_plant
    from sim_device.trials.offline_recorder import record

    def made(effects: Any, seed: int = 1, duration: float = 4.0, **encoders: object) -> list[Any]:
        plant = load_plant("paper", seed).model_dump()
        result = {"effects": effects, "encoders": EncoderConfig.model_validate(encoders)}
        return record(PlantConfig.model_validate(plant | result), paper, duration)

    return made


@pytest.fixture(scope="session")
def two_effects() -> Mapping[str, Mapping[str, float]]:
    return {"coulomb_joint1": {"torque_Nm": 1.5e-3}, "latency_joint2": {"delay_s": 5e-4}}


@pytest.fixture(scope="session")
def two_runs(recorded: Callable[..., list[Any]], two_effects: Mapping[str, Mapping[str, float]]) -> list[Any]:
    return recorded(two_effects)


@pytest.fixture(scope="session")
def two_found(made_once: Callable[..., Path], two_runs: list[Any], paper: Rig) -> Any:
    """Diagnosis of a rig with two effects, computed once for all test processes."""
    from dpr_lab.gap.diagnose import diagnose
    from dpr_lab.gap.result.diagnosis import Diagnosis

    def saved(folder: Path) -> None:
        (folder / "diagnosis.json").write_text(diagnose(two_runs, paper).model_dump_json(), encoding="utf-8")

    text = (made_once("two_found", saved) / "diagnosis.json").read_text(encoding="utf-8")
    return Diagnosis.model_validate_json(text)


@pytest.fixture(scope="session")
def screened(paper: Rig) -> Callable[..., Any]:
    """Fixture (runs, rig) that returns the `Recordings`."""
    from dpr_lab.gap.screen.record import record
    from dpr_lab.gap.screen.recordings import Recordings

    return lambda runs, rig=paper: Recordings(tuple(record(run, rig) for run in runs), rig)


@pytest.fixture(scope="session")
def bare(screened: Callable[..., Any]) -> Callable[..., Any]:
    """Fixture (runs[, rig]): segments, and the bare model fitted to them."""
    from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios

    def fitted(*args: Any) -> Any:
        recordings = screened(*args)
        return fit_bare_model(recordings, nominal_ratios(recordings.rig))[1:]

    return fitted


@pytest.fixture(scope="session")
def tested() -> Callable[..., Any]:
    """Fixture (problem, fit, effects): score test of effects whose shapes do not depend on the recordings."""
    from dpr_lab.effects.effect import Recorded
    from dpr_lab.gap.hypothesis.score_test import score_test

    nothing = Recorded((None,))
    return lambda problem, fit, effects: score_test(problem, fit, effects, nothing)


@dataclass(frozen=True)
class Served:
    """Simulated device on its link, run in a thread of this process."""

    url: str
    board: Any
    thread: threading.Thread


@pytest.fixture(scope="session")
def library() -> Any:
    """C firmware compiled for this machine; the test is skipped if it cannot be compiled."""
    from dpr_lab.errors import ConfigError
    from sim_device.firmware.c_firmware import load

    try:
        return load()
    except ConfigError as error:
        pytest.skip(str(error))


@pytest.fixture
def simulated(request: pytest.FixtureRequest) -> Iterator[Callable[..., Served]]:
    """Fixture (options of `sim_device.options.Options`): device that runs until the test ends."""
    from sim_device.assemble import assemble
    from sim_device.options import Options
    from sim_device.serve import serve

    stop, threads = threading.Event(), list[threading.Thread]()

    def start(**options: Any) -> Served:
        if options.get("firmware") == "c":
            request.getfixturevalue("library")
        board, link, faults = assemble(Options(**{"clock": "fast", "seed": 1, **options}))
        thread = threading.Thread(target=serve, args=(board, link, faults, stop.is_set))
        thread.start()
        threads.append(thread)
        return Served(link.address.url, board, thread)

    yield start
    stop.set()
    for thread in threads:
        thread.join(STOP_TIMEOUT_S)
    assert not any(thread.is_alive() for thread in threads)


@dataclass
class Spy:
    """Transport that records the numbers of the sent messages and can drop received samples."""

    inner: Transport
    lose_every: int = 0
    """Drop every n-th sample; 0: none."""
    sent: list[int] = field(default_factory=list)
    releases: set[bytes] = field(default_factory=set)
    """Contents of the RELEASE commands. A repeated command has the same content."""
    _samples: int = 0

    @property
    def url(self) -> str:
        return self.inner.url

    @property
    def errors(self) -> dict[str, int]:
        return self.inner.errors

    @property
    def capacities(self) -> tuple[Capacity, ...]:
        return self.inner.capacities

    def send(self, frame: Frame) -> None:
        self.sent.append(frame.number)
        if frame.number == NUMBERS[Release]:
            self.releases.add(frame.data)
        self.inner.send(frame)

    def receive(self, timeout: float) -> Received:
        received = self.inner.receive(timeout)
        return Received(received.host_time, tuple(filter(self._arrives, received.frames)), received.raw)

    def close(self) -> None:
        self.inner.close()

    def _arrives(self, frame: Frame) -> bool:
        if frame.number != NUMBERS[Sample] or not self.lose_every:
            return True
        self._samples += 1
        return self._samples % self.lose_every != 0


@pytest.fixture(scope="session")
def spy_on() -> type[Spy]:
    """Fixture (link, number of dropped samples): link with a `Spy`."""
    return Spy
