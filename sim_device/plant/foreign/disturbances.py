"""Brakes, wind and a tilting table: torques that depend on position or time."""

import math

from sim_device.plant.foreign.effect import OutOfLibraryEffect, Size, Values
from sim_device.plant.foreign.engine import Body, EquationOfMotion, under
from sim_device.plant.foreign.torques import drag_on_outer_rod

AIR_DRAG = 5e-3
"""Drag of a rod of 8 mm diameter in air at 1 m/s, N per metre of its length."""


def cable_snag(body: Body, values: Values) -> EquationOfMotion:
    """Add a cable that gets caught once: tau1 = -c omega1 exp(-((t - t0) / T)^2)."""
    size, begin_s, lasts = values["brake_Nms_per_rad"], values["at_s"], values["lasts_s"]

    def torques(t: float, theta1: float, theta2: float, omega1: float, omega2: float) -> tuple[float, float]:
        return -size * omega1 * math.exp(-(((t - begin_s) / lasts) ** 2)), 0.0

    return under(body, torques)


def eddy_brake(body: Body, values: Values) -> EquationOfMotion:
    """Add a magnet that brakes the inner rod near one angle: tau1 = -c omega1 exp(K (cos(theta1 - q0) - 1))."""
    size, narrow, place = values["brake_Nms_per_rad"], values["narrowness"], values["place_rad"]

    def torques(t: float, theta1: float, theta2: float, omega1: float, omega2: float) -> tuple[float, float]:
        return -size * omega1 * math.exp(narrow * (math.cos(theta1 - place) - 1)), 0.0

    return under(body, torques)


def air_draught(body: Body, values: Values) -> EquationOfMotion:
    """Add gusts of wind across the outer rod; the torque is the difference from the drag in still air.

    F = -K [|v - u| (v - u) - |v| v],    u = U (1 + sin(2 pi t / T) / 2) cos(theta2)
    """
    speed, period = values["wind_m_per_s"], values["gusts_s"]

    def torques(t: float, theta1: float, theta2: float, omega1: float, omega2: float) -> tuple[float, float]:
        wind = speed * (1 + 0.5 * math.sin(2 * math.pi * t / period)) * math.cos(theta2)
        blown = drag_on_outer_rod(body, AIR_DRAG, 2.0, theta1, theta2, omega1, omega2, wind)
        still = drag_on_outer_rod(body, AIR_DRAG, 2.0, theta1, theta2, omega1, omega2)
        return blown[0] - still[0], blown[1] - still[1]

    return under(body, torques)


def leaning_table(body: Body, values: Values) -> EquationOfMotion:
    """Tilt the table for a moment, as if a person leans on it: gravity turns by A exp(-((t - t0) / T)^2)."""
    size, begin_s, lasts = values["tilt_rad"], values["at_s"], values["lasts_s"]

    def torques(t: float, theta1: float, theta2: float, omega1: float, omega2: float) -> tuple[float, float]:
        tilt = size * math.exp(-(((t - begin_s) / lasts) ** 2))
        return (
            body.e1 * (math.sin(theta1 + tilt) - math.sin(theta1)),
            body.e2 * (math.sin(theta2 + tilt) - math.sin(theta2)),
        )

    return under(body, torques)


DISTURBANCES = (
    OutOfLibraryEffect(
        "cable_snag",
        "the cable catches once",
        Size("brake_Nms_per_rad", 0.01, 0.05),
        shape=(Size("at_s", 1.0, 5.0), Size("lasts_s", 0.05, 0.2)),
        motion=cable_snag,
        dissipative=True,
        held_back=True,
    ),
    OutOfLibraryEffect(
        "eddy_brake",
        "a magnet brakes the inner rod in one sector",
        Size("brake_Nms_per_rad", 2e-3, 1e-2),
        shape=(Size("narrowness", 10.0, 40.0), Size("place_rad", 2.0, 4.3)),
        motion=eddy_brake,
        dissipative=True,
    ),
    OutOfLibraryEffect(
        "air_draught",
        "wind in gusts across the outer rod",
        Size("wind_m_per_s", 0.3, 1.5),
        shape=(Size("gusts_s", 0.7, 2.5),),
        motion=air_draught,
    ),
    OutOfLibraryEffect(
        "leaning_table",
        "a person leans on the table for a short time",
        Size("tilt_rad", 5e-3, 2e-2),
        sign="any",
        shape=(Size("at_s", 2.0, 6.0), Size("lasts_s", 0.3, 1.0)),
        motion=leaning_table,
        held_back=True,
    ),
)
