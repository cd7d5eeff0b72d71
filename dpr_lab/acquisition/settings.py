"""Settings of a capture: timing, definition of rest, and limits of the quality checks."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class DeviceTiming:
    """Timing of the connection to a device."""

    read_s: float = 0.02
    """Maximum waiting time of a read, s. Keepalives and retries are delayed by at most this time."""
    silence_s: float = 1.0
    """Time without messages after which a device counts as lost, s. A device reports ten times per second."""
    simulated_patience: float = 3.0
    """Factor on `silence_s` for a device with simulated time, which shares the processor of the host."""
    ping_s: float = 0.9839
    """Interval of pings, s. It is not a round number, to avoid beats with periodic events."""
    quick_pings: int = 8
    """Number of faster pings at the start of a stream. They give a clock fit within the first second."""
    quick_ping_s: float = 0.05
    exchanges: int = 4096
    """Number of pings that are kept for the clock fit: those of an hour."""


@dataclass(frozen=True, slots=True)
class RestLimits:
    """Limits within which the rods count as being at rest."""

    window_s: float = 1.0
    """Duration for which the rods must be at rest, s."""
    speed: float = 0.02
    """Maximum drift, rad/s. A rod held by hand drifts faster, a rod held by the latch does not drift."""
    spread_over_noise: float = 4.0
    """Maximum vibration, in standard deviations of the encoder noise."""
    spread_counts: float = 2.0
    """Maximum vibration for encoders with hardly any noise, counts."""

    def spread(self, rig: Rig) -> float:
        """Return the maximum vibration of a rod at rest, rad.

        It is the larger of two limits: `spread_over_noise` times the noise of the encoders, and `spread_counts`.
        """
        counts = max(self.spread_over_noise * rig.encoders.noise_counts, self.spread_counts)
        return counts * float(np.abs(rig.radians_per_count[1:]).max())


@dataclass(frozen=True, slots=True)
class QualityLimits:
    """Limits of the quality checks of a recording."""

    rest: RestLimits = RestLimits()
    release_window_s: float = 0.02
    """Duration of the first part of the swing, from which the initial speed is estimated, s."""
    fewest_samples: int = 8
    """Minimum number of samples for the checks of the rest and of the start of the swing."""
    release_speed: float = 0.2
    """Maximum initial speed, rad/s. The fit over 20 ms has an uncertainty of about 0.03 rad/s."""
    sigmas: float = 5.0
    """Initial speed of a rod, and jump of an angle, that may be noise, in standard deviations of its error due to the
    encoder noise."""
    lost_share: float = 1e-3
    gap_periods: int = 10
    """Maximum number of consecutive missing samples."""
    clock_ppm: float = 600.0
    """Maximum clock rate error of the device, ppm. All times have this relative error. Crystal oscillators stay below
    about 100 ppm."""
    clock_std_ppm: float = 10_000.0
    """Maximum standard deviation for which a clock rate is used, ppm. Two seconds of PING on a busy host give a tenth
    of this value."""
    real_pace_ppm: float = 300_000.0
    """Maximum difference of a steady clock rate from real time for which the clock counts as real, ppm. A simulated
    clock is many times faster."""
    latched_share: float = 0.5
    """Maximum share of STATUS messages after the release that still report a closed latch."""
    fewest_statuses: int = 3
    """Minimum number of STATUS messages after the release for the check of the latch."""
    jitter_periods: float = 0.05
    """Maximum irregularity of the sampling, rms in sample periods."""
    speed_margin: float = 1.5
    """Maximum ratio of the speed between two samples to the maximum possible speed; a larger ratio counts as a jump.
    The limit exceeds 1 because the values of the rig file are not exact."""
    travel_counts: int = 16
    """Minimum motion of an encoder during a swing, counts."""
    hang_error: float = 0.02
    """Maximum deviation of a rod at rest from hanging, rad. The friction of a small bearing holds it within a
    milliradian."""
    motor_on: float = 5.0
    """Maximum rms input of the motor of a free arm for which the motor counts as off, relative to the noise at rest and
    the resolution of the input."""


@dataclass(frozen=True, slots=True)
class CaptureSettings:
    """Settings of a capture."""

    limits: QualityLimits = QualityLimits()
    poll_s: float = 0.04
    """Maximum waiting time for messages, s. The run file requires a call every 50 ms."""
    report_s: float = 0.1
    """Interval of progress reports, s."""
    steady_readings: int = 3
    """Number of consecutive readings that must be within the tolerance of the pose."""
    hang_timeout_s: float = 2.0
    """Maximum duration of the check of the hanging rods, s."""
    hang_readings: int = 3
    hang_near: float = 0.35
    """Maximum deviation of a rod that counts as hanging, rad. A rod with a larger deviation is probably held by
    hand."""
    elbow_error: float = 0.2
    """Maximum difference between the angle of a clamped elbow and that of a pose, rad. It is large because a clamp is
    coarse, and the measured angle is used."""
    release_timeout_s: float = 2.0
    """Maximum waiting time for the message with the tick of the release, s."""
    last_status_s: float = 0.5
    """Maximum waiting time for the STATUS after STOP, s. This STATUS contains the final loss counters."""
    rest_after_s: float = 2.0
    """Duration for which the rods must be still after a swing to count as being at rest, s."""
    pace_window_s: float = 10.0
    """Duration for which samples may arrive slower than `slowest_pace` before the recording is ended, s. The
    duration is longer in simulated time."""
    slowest_pace: float = 0.1
    """Minimum rate at which the device's time passes, relative to the host's time."""
    silences_without_samples: float = 2.0
    """Time without a sample after which a device is regarded as failed although it still sends reports.

    It is a multiple of `DeviceTiming.silence_s`.
    """


DEVICE_TIMING, QUALITY_LIMITS, CAPTURE_SETTINGS = DeviceTiming(), QualityLimits(), CaptureSettings()
"""Default settings."""
