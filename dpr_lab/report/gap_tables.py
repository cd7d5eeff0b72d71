"""A diagnosis as rows of text."""

from dpr_lab.gap.diagnosis import Diagnosis
from dpr_lab.report.digits import three

EFFECT_COLUMNS = ("effect", "cannot be told from", "probability", "share of the gap", "parameters, 90 % interval")
RIVAL_COLUMNS = ("instead of", "rival", "probability", "cosine")
PLACE_COLUMNS = ("where", "by", "share of the gap", "what it looks like")
CLOSED_COLUMNS = ("run", "gap closed", "free run before (mrad)", "after (mrad)")
DETECTABLE_COLUMNS = ("effect", "least detectable size")
FINDING_COLUMNS = ("finding", "run", "axis", "at (s)", "evidence")

QUANTITIES = {
    "N m": ("torque (mN m)", 1e3),
    "N m s/rad": ("friction (mN m s/rad)", 1e3),
    "m": ("friction radius (mm)", 1e3),
    "rad": ("encoder error (mrad)", 1e3),
}
"""What a place's values are by their unit: label, and factor to the unit shown."""

COORDINATES = {
    "angle": "joint angle (rad)",
    "speed": "joint speed (rad/s)",
    "time": "time since release (s)",
    "load": "joint force (N)",
}


def effect_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """One row for each named effect."""
    return [
        (
            item.name,
            ", ".join(name for name in item.members if name != item.name) or "–",
            f"{item.probability:.0%}",
            f"{item.share:.1%}",
            "; ".join(
                f"{name} {three(number.value)} [{three(number.interval90[0])}, {three(number.interval90[1])}]"
                for name, number in item.parameters.items()
            ),
        )
        for item in diagnosis.effects
    ]


def rival_rows(diagnosis: Diagnosis, count: int = 6) -> list[tuple[str, ...]]:
    """The likeliest rivals."""
    return [
        (item.instead_of or "–", " or ".join(item.members), f"{item.probability:.2g}", f"{item.cosine:.4f}")
        for item in diagnosis.rivals[:count]
    ]


def place_rows(diagnosis: Diagnosis, count: int = 4) -> list[tuple[str, ...]]:
    """The places that explain most."""
    return [(item.site, item.coordinate, f"{item.share:.0%}", item.sentence) for item in diagnosis.where[:count]]


def closed_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """How far the gap closes, by run; runs held out by hand are marked."""
    gap, closed = diagnosis.gap, diagnosis.gap.closed_held_out
    shares = {name: (name, share) for name, share in closed.per_run.items()}
    shares |= {name: (f"{name} (held out)", share) for name, share in closed.held_out.items()}
    rows = []
    for name, (label, share) in shares.items():
        free = gap.free_run_rad.get(name, {})
        before, after = (three(1e3 * free[key]) if key in free else "–" for key in ("before", "after"))
        rows.append((label, f"{share:.1%}", before, after))
    return rows


def detectable_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Least detectable size of every effect on these recordings."""
    return [
        (
            name,
            ", ".join(f"{p} {three(size) if size is not None else 'not visible'}" for p, size in sizes.items()),
        )
        for name, sizes in diagnosis.detectable.items()
    ]


def finding_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Sensor faults."""
    return [
        (item.name, item.run, item.axis or "–", "–" if item.at_s is None else f"{item.at_s:.3f}", item.evidence)
        for item in diagnosis.sensor_findings
    ]
