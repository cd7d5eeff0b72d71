"""Out-of-library effects: no effect at zero size, consistent energy, and readings independent of the block size."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from dpr_lab.dynamics.simulate import simulate
from dpr_lab.effects import effect_params
from dpr_lab.errors import ConfigError
from sim_device.plant.config import load_plant
from sim_device.plant.foreign import FOREIGN
from sim_device.plant.foreign.bodies import AXIAL, wobbling_rod
from sim_device.plant.foreign.effect import Moment, OutOfLibraryEffect
from sim_device.plant.foreign.engine import Body, DryJoint, integrate, sticking, undisturbed
from sim_device.plant.foreign.torques import drag_on_outer_rod
from sim_device.plant.hidden import plant_of
from tests.thinned import thinned
from tests.whole_swing import energy

T = np.arange(0.0, 2.0, 0.01)
LONG = np.arange(0.0, 6.0, 0.01)  # some disturbances come late
START = np.array([0.1, 3.0, 0.5, -0.3])
MOVED = [name for name, effect in FOREIGN.items() if effect.motion is not None]
BRAKES = [name for name, effect in FOREIGN.items() if effect.dissipative]


@pytest.fixture
def body(paper) -> Body:
    return Body.of(paper.nominal, 0.4, 0.4, 9.81)


def values_of(effect: OutOfLibraryEffect, share: float = 1.0) -> dict[str, float]:
    middle = {size.name: (size.lower + size.upper) / 2 for size in effect.shape}
    return {effect.amplitude.name: effect.amplitude.upper * share, **middle}


def swing(body: Body, effect: OutOfLibraryEffect, share: float, t: np.ndarray = T) -> np.ndarray:
    assert effect.motion is not None
    motion = effect.motion(body, values_of(effect, share))
    return integrate(motion, np.array([*START, *motion.memory]), t)


def rods_energy(body: Body, states: np.ndarray) -> np.ndarray:
    return np.array([energy(*x[:4], body.a, body.b, body.d, body.e1, body.e2) for x in states])


@pytest.mark.parametrize("name", MOVED)
def test_no_size_no_effect_on_the_swing(body, name):
    free = integrate(undisturbed(body), START, T)
    assert np.abs(swing(body, FOREIGN[name], 0.0)[:, :4] - free).max() < 1e-6


@pytest.mark.parametrize("name", thinned([name for name in MOVED if FOREIGN[name].reading is None], 3))
def test_a_foreign_effect_changes_the_swing(body, name):
    free, moved = integrate(undisturbed(body), START, LONG), swing(body, FOREIGN[name], 1.0, LONG)
    assert np.abs(moved[:, :2] - free[:, :2]).max() > 1e-3


@pytest.mark.parametrize("joint", [1, 2])
def test_a_slide_shorter_than_a_step_ends(body, joint):
    """A joint that is let go at the limit and turned back at once slides, and rests again."""
    t, tried = np.arange(0.0, 0.05, 0.005), 0
    for angle in np.linspace(0.3, 6.0, 12):
        start = np.array([2.9, angle, 2.0 * (joint == 2), 2.0])
        holding = DryJoint(joint, lambda x: 0.0).holding
        later = start + 1e-4 * np.array([*start[2:], 0.0, 0.0])
        if abs(holding(body, later)) < abs(holding(body, start)):
            limit = abs(holding(body, start)) * (1 - 1e-7)
            result = integrate(sticking(body, joint, lambda x, limit=limit: limit), start, t)
            assert np.ptp(result[:, joint - 1] - (joint - 1) * result[:, 0]) < 1e-3
            tried += 1
    assert tried > 2


@pytest.mark.parametrize("name", BRAKES)
def test_a_brake_never_adds_energy(body, name):
    frictionless = Body(**{f: getattr(body, f) for f in body.__slots__} | {"c1": 0.0, "c2": 0.0})
    states = swing(frictionless, FOREIGN[name], 5.0, LONG)
    assert (np.diff(rods_energy(frictionless, states)) < 1e-8).all()
    assert rods_energy(frictionless, states[[-1]])[0] < rods_energy(frictionless, states[[0]])[0] - 1e-5


@pytest.mark.parametrize("name", [name for name, effect in FOREIGN.items() if effect.reading or effect.counter])
def test_no_size_no_error_of_the_encoders(name):
    effect, rng = FOREIGN[name], np.random.default_rng(1)
    joints = rng.uniform(-9.0, 9.0, (500, 2))
    moment = Moment(np.linspace(0, 10, 500), np.zeros((500, 5)), rng.standard_normal((500, 3)))
    if effect.reading is not None:
        assert np.array_equal(effect.reading(joints, moment, values_of(effect, 0.0)), joints)
    if effect.counter is not None:
        counts = rng.integers(-9999, 9999, (500, 3))
        assert np.array_equal(effect.counter(counts, values_of(effect, 0.0)), counts)
        assert not np.array_equal(effect.counter(counts, values_of(effect)), counts)


@pytest.mark.parametrize("joint", [1, 2])
@pytest.mark.parametrize("torque", [0.05, 0.3])
def test_a_sticking_joint_agrees_with_the_independent_code_of_dpr_lab(body, joint, torque):
    start, t = np.array([np.pi + 0.4, np.pi + 1.1, 0.0, 0.0]), np.linspace(0, 2, 41)
    result = integrate(sticking(body, joint, lambda x: torque), start, t)
    base = [body.a, body.b, body.d, body.e1, body.c1, body.c2]
    params = effect_params({f"coulomb_joint{joint}": {"torque_Nm": torque}})
    assert result == pytest.approx(simulate(base, body.L1, body.g, start, t, 2e-4, params), abs=1e-6)
    speed = result[:, 2] if joint == 1 else result[:, 3] - result[:, 2]
    assert (np.abs(speed) < 1e-12).sum() > (5 if torque == 0.3 else 0)


def test_the_wobbling_rod_keeps_its_energy(body):
    """Kinetic and potential energy from the positions of the centres of mass, not from the equation of motion."""
    free = Body(**{f: getattr(body, f) for f in body.__slots__} | {"c1": 0.0, "c2": 0.0})
    motion = wobbling_rod(free, {"start_rad": 0.2, "frequency_hz": 2.0, "damping_ratio": 0.0})
    states = integrate(motion, np.array([*START, *motion.memory]), T)
    t1, t2, w1, w2, phi, u = states.T
    cross = np.cos(phi) * np.cos(t1 - t2) * w2 + np.sin(phi) * np.sin(t1 - t2) * u
    turning = free.b * (np.cos(phi) ** 2 + AXIAL * np.sin(phi) ** 2)
    kinetic = 0.5 * free.a * w1**2 + 0.5 * free.b * u**2 + 0.5 * turning * w2**2 + free.d * w1 * cross
    spring = 0.5 * free.b * (4 * math.pi) ** 2 * phi**2
    total = kinetic + free.e1 * np.cos(t1) + free.e2 * np.cos(t2) * np.cos(phi) + spring
    assert np.ptp(total) < 1e-7
    assert np.ptp(phi) > 0.1


def test_the_undamped_bending_rod_keeps_its_energy(body):
    free = Body(**{f: getattr(body, f) for f in body.__slots__} | {"c1": 0.0, "c2": 0.0})
    motion = FOREIGN["bending_rod"].motion(free, {"compliance_rad_per_Nm": 0.3, "damping_ratio": 0.0})
    t1, t2, w1, w2, q, u = (states := integrate(motion, np.array([*START, 0.0, 0.0]), T)).T
    p, i, r, h = 5 / 16 * free.b, free.b / 8, free.d / 4, free.e2 / 4
    bent = p * w2 * u + r * np.cos(t1 - t2) * w1 * u + 0.5 * i * u**2 - h * q * np.sin(t2) + q**2 / 0.6
    assert np.ptp(rods_energy(free, states) + bent) < 1e-7
    assert np.ptp(q) > 1e-3


def test_the_drag_is_the_integral_along_the_rod(body):
    theta1, theta2, omega1, omega2, exponent = 0.3, 1.1, 2.0, -7.0, 1.7
    lever = body.L1 * math.cos(theta1 - theta2)

    def drag(s: float) -> float:
        v = lever * omega1 + s * omega2
        return -0.004 * abs(v) ** (exponent - 1) * v

    tau1 = quad(lambda s: drag(s) * lever, 0, body.L2)[0]
    tau2 = quad(lambda s: drag(s) * s, 0, body.L2)[0]
    result = drag_on_outer_rod(body, 0.004, exponent, theta1, theta2, omega1, omega2)
    assert result == pytest.approx((tau1, tau2), rel=3e-3)


def foreign_plant(paper, name: str):
    return plant_of(load_plant("paper", 3).model_copy(update={"foreign": {name: values_of(FOREIGN[name])}}), paper)


@pytest.mark.parametrize("name", ["lugre_friction_joint2", "emi_bursts", "overspeed_loss"])
def test_every_reading_of_a_foreign_swing_gives_the_same_bits(paper, name):
    def let_go():
        return foreign_plant(paper, name).let_go(np.array([0.0, 0.1, 0.1]), np.zeros(3), 1000.0, 1)

    whole, pieces = let_go().theta(0, 2500), let_go()
    read, tick = [], 0
    for count in [1, 2, 997, 1, 999, 3, 400, 97]:
        read.append(pieces.theta(tick, count))
        tick += count
    assert np.array_equal(np.concatenate(read), whole)
    with pytest.raises(ValueError, match=r"no longer available \(requested: 3\)"):
        pieces.theta(3, 1)


def test_a_foreign_effect_stands_alone_and_is_spelled_out(paper):
    config = load_plant("paper")
    good = {"mains_hum": {"error_rad": 1e-3, "phase_rad": 0.0}}
    for changes, result in (
        ({"foreign": good, "effects": {"base_tilt": {"tilt_rad": 0.01}}}, "cannot be combined"),
        ({"foreign": {"gremlins": {}}}, "no foreign effect 'gremlins'"),
        ({"foreign": {"mains_hum": {"error_rad": 1e-3}}}, "has the parameters error_rad, phase_rad"),
    ):
        with pytest.raises(ConfigError, match=result):
            plant_of(config.model_copy(update=changes), paper)
