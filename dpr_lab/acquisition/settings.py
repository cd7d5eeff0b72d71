"""How long a capture waits, how often it looks, and what it takes for rest or for a good recording."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class DeviceTiming:
    """Timing of the connection to a device."""

    read_s: float = 0.02
    """How long a read may wait, and so how late a keepalive or a retry can be."""
    silence_s: float = 1.0
    """How long a device may say nothing before it counts as lost; it reports ten times a second."""
    simulated_patience: float = 3.0
    """Times as long for a device whose time is simulated: it shares the host's processor."""
    ping_s: float = 0.9839
    """Between two pings; not a round number, so that they do not beat with anything periodic."""
    quick_pings: int = 8
    """So many come faster after the start of a stream, so that its first second already yields a clock fit."""
    quick_ping_s: float = 0.05
    exchanges: int = 4096
    """Pings kept for the clock fit: an hour of them."""


@dataclass(frozen=True, slots=True)
class RestLimits:
    """Limits within which the rods count as at rest."""

    window_s: float = 1.0
    """How long the rods must be seen to be still."""
    speed: float = 0.02
    """Fastest drift, rad/s; a rod held by hand drifts faster, one held by the latch does not."""
    spread_over_noise: float = 4.0
    """Widest shaking, in standard deviations of the encoder noise."""
    spread_counts: float = 2.0
    """Widest shaking of encoders with hardly any noise, counts."""

    def spread(self, rig: Rig) -> float:
        """The widest shaking of a rod at rest: a few times the encoder noise, at least two counts, rad."""
        counts = max(self.spread_over_noise * rig.encoders.noise_counts, self.spread_counts)
        return counts * float(np.abs(rig.radians_per_count[1:]).max())


@dataclass(frozen=True, slots=True)
class QualityLimits:
    """Limits of a good recording."""

    rest: RestLimits = RestLimits()
    release_window_s: float = 0.02
    """The first moment of the swing, which shows the speed at the release."""
    fewest_samples: int = 8
    """What rest and first moment must hold to be judged."""
    release_speed: float = 0.2
    """rad/s; the fit over 20 ms is itself uncertain by about 0.03 rad/s."""
    sigmas: float = 5.0
    """Standard deviations that coarse counts may add to a speed: that is nobody's push and no jump."""
    lost_share: float = 1e-3
    gap_periods: int = 10
    """Samples missing in a row."""
    clock_ppm: float = 600.0
    """Error of the device's clock by the host's; a crystal keeps to some 100, and times are wrong by as much."""
    clock_std_ppm: float = 10_000.0
    """Standard deviation of a clock rate that shows nothing; two seconds of PING on a busy host reach a tenth of it."""
    real_pace_ppm: float = 300_000.0
    """A steady pace nearer to real time than this is no simulated clock, which is many times faster."""
    latched_share: float = 0.5
    """Share of the STATUS messages after the release that may still say that the latch holds."""
    fewest_statuses: int = 3
    """STATUS messages that show whether the latch opened."""
    jitter_periods: float = 0.05
    """rms"""
    speed_margin: float = 1.5
    """Times the fastest speed possible that is still no jump: the rig file's values are not exact."""
    travel_counts: int = 16
    """Least that an encoder must have moved by."""
    hang_error: float = 0.02
    """rad; dry friction of a small bearing holds a rod within a milliradian of hanging."""


@dataclass(frozen=True, slots=True)
class CaptureSettings:
    """Settings of a capture."""

    limits: QualityLimits = QualityLimits()
    poll_s: float = 0.04
    """How long to wait for news; the run file wants a call every 50 ms."""
    report_s: float = 0.1
    """Between two reports of how far it is."""
    steady_readings: int = 3
    """So many readings in a row must be at the pose."""
    hang_timeout_s: float = 2.0
    """How long to look whether the rods hang still."""
    hang_readings: int = 3
    hang_near: float = 0.35
    """rad; a rod further off hangs from a hand."""
    release_timeout_s: float = 2.0
    """How long the message with the instant of the release may take."""
    last_status_s: float = 0.5
    """How long the last status, which counts what was lost, may take after the stop."""
    rest_after_s: float = 2.0
    """How long the rods must be still after a swing to have come to rest."""
    pace_window_s: float = 10.0
    """How long samples may come slower than `slowest_pace` before that ends a recording; more in simulated time."""
    slowest_pace: float = 0.1
    """Seconds of the device in a second of the host."""
    silences_without_samples: float = 2.0
    """Silences (`DeviceTiming.silence_s`) without a sample after which a device that still reports has failed."""


DEVICE_TIMING, QUALITY_LIMITS, CAPTURE_SETTINGS = DeviceTiming(), QualityLimits(), CaptureSettings()
"""As they are used unless a caller brings others."""
