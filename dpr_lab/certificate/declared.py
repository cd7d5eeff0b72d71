"""Choices and origin of a certified diagnosis, which a repetition of the diagnosis cannot verify."""

from collections.abc import Iterator, Mapping

from dpr_lab.certificate.document import Certificate
from dpr_lab.certificate.lines import Declared
from dpr_lab.certificate.signature import MISSING, fingerprint, installed
from dpr_lab.effects import EFFECTS

EVERYTHING = f"all {len(EFFECTS)} effects"


def choices_of(certificate: Certificate) -> list[Declared]:
    """Return the free choices of the certified diagnosis.

    If a choice differs from its default, its note names the default.
    """
    choices, recordings = certificate.choices, certificate.recordings
    library, without, truncated = choices.library, ", ".join(choices.without), certificate.truncated_recordings
    return [
        Declared("fitted recordings", ", ".join(recording.file for recording in recordings if not recording.held_out)),
        Declared(
            "held-out recordings", ", ".join(recording.file for recording in recordings if recording.held_out) or "none"
        ),
        *([Declared("truncated recordings", ", ".join(truncated))] if truncated else []),
        Declared("rig file", f"{certificate.rig.file} (SHA-256 {certificate.rig.sha256[:12]})"),
        Declared("library", EVERYTHING) if library is None else _not_default("library", ", ".join(library), EVERYTHING),
        _choice("excluded effects", without or "none", "none"),
        _choice("maximum number of effects", str(choices.max_effects), "4"),
        _choice("seed", str(choices.seed), "0"),
        _choice("any device clock", "accepted" if choices.any_clock else "refused", "refused"),
        _choice("torques", choices.torque or "measured where known", "measured where known"),
    ]


def _choice(name: str, value: str, default: str) -> Declared:
    return Declared(name, value) if value == default else _not_default(name, value, default)


def _not_default(name: str, value: str, default: str) -> Declared:
    return Declared(name, value, f"default: {default}")


def origin_of(certificate: Certificate, current: Mapping[str, str]) -> list[Declared]:
    """Return the origin of a diagnosis: policy, code, libraries, machine and signature.

    Args:
        certificate: the certificate
        current: versions of the installed code, from `dpr_lab.certificate.code.made_with`; a note names each version
            that differs
    """
    return [Declared("policy", str(certificate.policy)), *_made_with(certificate, current), _signed(certificate)]


def _made_with(certificate: Certificate, current: Mapping[str, str]) -> Iterator[Declared]:
    for name, value in certificate.made_with.model_dump().items():
        yield Declared(f"made with: {name}", value, "" if value == current[name] else f"here: {current[name]}")


def _signed(certificate: Certificate) -> Declared:
    if certificate.signature is None:
        return Declared("signature", "none", "the author is unknown")
    key = fingerprint(certificate.signature.public_key)
    return Declared("signature", f"by key {key}", "" if installed() else f"not checked: {MISSING}")
