"""A new effect requires one file and one table entry; its kernel is compiled."""

import pytest

from tests.extension.conftest import Copy


@pytest.mark.long
def test_an_effect_with_memory_or_a_continuous_shape_is_a_file_and_a_row(copy: Copy) -> None:
    copy.add(
        "dpr_lab/effects/cable.py",
        '''
        """A cable across joint 2 that springs back, and slips beyond a stretch."""

        from dpr_lab.effects.effect import Effect, EffectParameter, InternalState, shape
        from dpr_lab.effects.quantities import Joint
        from dpr_lab.kernels import njit


        @njit
        def stretched(stretch: float, displacement: float, slip_rad: float) -> float:
            return min(max(stretch + displacement, -slip_rad), slip_rad)


        @njit
        def cable(joint: Joint, stretch: float, stiffness_Nm_per_rad: float, slip_rad: float) -> float:
            return -stiffness_Nm_per_rad * stretched(stretch, joint.displacement, slip_rad)


        CABLE_JOINT2 = Effect(
            name="cable_joint2",
            words="cable that slips, joint 2",
            equation="tau = -k z, z follows the angle of joint 2 and stays within +-slip",
            parameters=(
                EffectParameter("stiffness_Nm_per_rad", "N m/rad", 5e-3, "positive"),
                shape("slip_rad", "rad", 0.5, (0.2, 0.5, 1.0), continuous=True),
            ),
            site="joint torque",
            stage="torque",
            kernel=cable,
            joints=(1,),
            internal=(InternalState("stretch", "rad", after=stretched),),
            dissipative=True,
            bench_check="Take the cable off.",
            source="Prandtl (1928), Z. angew. Math. Mech. 8, 85-106.",
        )
        ''',
    )
    copy.row("dpr_lab/effects/__init__.py", "EFFECTS", "CABLE_JOINT2", "from dpr_lab.effects.cable import CABLE_JOINT2")
    copy.add(
        "dpr_lab/effects/magnet.py",
        '''
        """A magnet near the hanging position of the inner rod."""

        import math

        from dpr_lab.effects.effect import Effect, EffectParameter, shape
        from dpr_lab.effects.quantities import Joint
        from dpr_lab.kernels import njit


        @njit
        def pull(joint: Joint, torque_Nm: float, width_rad: float) -> float:
            x = math.sin(joint.angle) / width_rad
            return -torque_Nm * x * math.exp(-x * x)


        MAGNET_JOINT1 = Effect(
            name="magnet_joint1",
            words="magnet, joint 1",
            equation="tau = -T x exp(-x^2), x = sin(q1) / width",
            parameters=(
                EffectParameter("torque_Nm", "N m", 1e-2, "any"),
                shape("width_rad", "rad", 0.3, (0.1, 0.3, 0.6), continuous=True),
            ),
            site="joint torque",
            stage="torque",
            kernel=pull,
            joints=(0,),
            potential=True,
            bench_check="Look for iron below the rig.",
            source="A dipole's field falls with distance.",
        )
        ''',
    )
    copy.row(
        "dpr_lab/effects/__init__.py", "EFFECTS", "MAGNET_JOINT1", "from dpr_lab.effects.magnet import MAGNET_JOINT1"
    )
    result = copy.run(
        """
        import numpy as np
        from dpr_lab.effects import EFFECTS
        from dpr_lab.gap.diagnose import diagnose
        from dpr_lab.rig import load_rig
        from sim_device.plant.config import load_plant
        from sim_device.trials.offline_recorder import record
        from sim_device.trials.parameters import weighed

        plant, rig = weighed(load_plant("paper", 5), load_rig("paper"))
        bare = record(plant, rig, duration=4.0)
        library = {name: EFFECTS[name] for name in ("cable_joint2", "magnet_joint1")}
        values = {
            "cable_joint2": {"stiffness_Nm_per_rad": 0.02, "slip_rad": 0.3},
            "magnet_joint1": {"torque_Nm": 0.04, "width_rad": 0.4},
        }
        for name in library:
            runs = record(plant.model_copy(update={"effects": {name: values[name]}}), rig, duration=4.0)
            moved = any(not np.array_equal(one.counts, other.counts) for one, other in zip(runs, bare))
            found = diagnose(runs, rig, library=library, max_effects=1)
            fitted = found.effects[0].parameters
            close = all(abs(fitted[p].value / value - 1) < 0.2 for p, value in values[name].items())
            print(name, moved, found.verdict, [effect.name for effect in found.effects], close)
        """,
        timeout=580.0,
        cache=True,
    )
    assert result == "".join(f"{name} True named ['{name}'] True\n" for name in ("cable_joint2", "magnet_joint1"))
