"""Writing and verification of certificates of a diagnosis; the verification repeats the diagnosis."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import ConfigError
from dpr_lab.workflows.accept import judged
from dpr_lab.workflows.checks import check_file_writable
from dpr_lab.workflows.diagnose import DiagnoseRequest, diagnose
from dpr_lab.workflows.events import OnEvent, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from dpr_lab.acceptance.judge import Acceptance
    from dpr_lab.acceptance.limits import Limits
    from dpr_lab.certificate.document import Certificate
    from dpr_lab.certificate.lines import Declared, Verified
    from dpr_lab.certificate.policy import RequiredClaim
    from dpr_lab.gap.result.diagnosis import Diagnosis


@dataclass(frozen=True, slots=True)
class Certified:
    """Written certificate, with the claims that its policy requires."""

    certificate: "Certificate"
    choices: "list[Declared]"
    origin: "list[Declared]"
    claims: "dict[str, RequiredClaim]"
    """Required claims with their tolerances."""


@dataclass(frozen=True, slots=True)
class VerifiedCertificate:
    """Result of a verification."""

    choices: "list[Declared]"
    """Free choices of the diagnosis. A repetition cannot confirm them."""
    origin: "list[Declared]"
    """Code, libraries, machine and signature. A repetition cannot confirm them."""
    lines: "list[Verified]"
    """Results of the verification: files, signature and claims."""

    @property
    def holds(self) -> bool:
        """Whether every file, the signature and every claim are confirmed."""
        return all(line.holds for line in self.lines)

    @property
    def names_other_code(self) -> bool:
        """Whether the certificate names a different version or hash than the installed code."""
        return any(
            declared.note for declared in self.origin if declared.name in ("made with: dpr_lab", "made with: code")
        )


def certify(
    request: DiagnoseRequest,
    to: Path,
    on_event: OnEvent = ignore,
    sign_with: Path | None = None,
    passphrase: Callable[[], str] | None = None,
    limits: Path | None = None,
) -> Certified:
    """Diagnose runs, and write a certificate of the diagnosis that others can verify.

    See `diagnose` for events and errors.

    Args:
        request: options of the diagnosis, without an initial model
        to: the file to write
        on_event: called with the events
        sign_with: file of an Ed25519 private key; None: no signature
        passphrase: function that asks for the passphrase of the key
        limits: limits file of `accept`, whose results are also certified; None: no limits

    Raises:
        ConfigError: the key or the limits cannot be used, the file cannot be written, or the request starts from a
            model.
    """
    from dpr_lab.acceptance.limits import load_limits
    from dpr_lab.certificate.code import made_with
    from dpr_lab.certificate.declared import choices_of, origin_of
    from dpr_lab.certificate.policy import required_claims
    from dpr_lab.certificate.signature import load_private_key, sign
    from dpr_lab.planning.limits import PlanLimits
    from dpr_lab.whole_file import write_text

    check_file_writable(to)
    if request.model is not None:
        raise ConfigError("a certified diagnosis starts from the rig file: remove the model")
    key = load_private_key(sign_with, passphrase) if sign_with else None
    requirements = load_limits(limits, PlanLimits) if limits else None
    diagnosis = diagnose(request, on_event).diagnosis
    claims = required_claims(diagnosis, _accepted(diagnosis, requirements, request))
    certificate = _certificate(request, to.parent, claims, limits)
    if key is not None:
        certificate = sign(certificate, key)
    write_text(to, certificate.to_text())
    return Certified(certificate, choices_of(certificate), origin_of(certificate, made_with()), claims)


def _accepted(diagnosis: "Diagnosis", limits: "Limits | None", request: DiagnoseRequest) -> "Acceptance | None":
    """Return the results of the equivalence tests of the limits, with the fitted runs of a request.

    The result is None if no limits are given.
    """
    from dpr_lab.rig import load_rig

    if limits is None:
        return None
    rig = load_rig(request.rig)
    runs = read_runs(request.runs, rig, ignore, request.any_clock, request.torque)
    return judged(diagnosis, limits, runs, rig)


def _certificate(
    request: DiagnoseRequest, folder: Path, claims: "Mapping[str, RequiredClaim]", limits: Path | None
) -> "Certificate":
    from dpr_lab.certificate.code import made_with
    from dpr_lab.certificate.document import POLICY, Certificate, CertifiedChoices, MadeWith
    from dpr_lab.certificate.files import certify_limits, certify_recording, certify_rig, truncated_recordings

    recordings = [
        *(certify_recording(path, folder, held_out=False) for path in request.runs),
        *(certify_recording(path, folder, held_out=True) for path in request.held_out),
    ]
    choices: dict[str, Any] = {name: getattr(request, name) for name in CertifiedChoices.model_fields}
    return Certificate(
        policy=POLICY,
        recordings=recordings,
        rig=certify_rig(request.rig, folder),
        limits=certify_limits(limits, folder) if limits else None,
        truncated_recordings=truncated_recordings(recordings, folder),
        choices=CertifiedChoices(**choices),
        made_with=MadeWith(**made_with()),
        claims={name: required.claim for name, required in claims.items()},
        signature=None,
    ).sealed()


def verify(
    path: Path,
    on_event: OnEvent = ignore,
    signed_by: Path | None = None,
    *,
    other_code: bool = False,
    same_libraries: bool = False,
) -> VerifiedCertificate:
    """Repeat a certified diagnosis and compare each claim that the policy requires.

    The diagnosis is repeated only if files, seal, signature and code are valid.

    Args:
        path: the certificate; its recordings must be at the paths that it names
        on_event: called with the events
        signed_by: file of the Ed25519 public key of the required signature; None: no signature is required
        other_code: whether the certificate may name code that differs from the installed code, for example an older
            version
        same_libraries: whether the versions of Python and the libraries must match the certificate

    Raises:
        RunError: the file is not a certificate of this policy.
        ConfigError: its rig file is missing or not valid, or the key cannot be used.
    """
    from dpr_lab.acceptance.limits import load_limits
    from dpr_lab.certificate.code import compare_code, made_with
    from dpr_lab.certificate.declared import choices_of, origin_of
    from dpr_lab.certificate.document import load_certificate
    from dpr_lab.certificate.files import compare_limits, compare_recording, compare_rig, compare_truncated
    from dpr_lab.certificate.policy import compare_claims
    from dpr_lab.certificate.signature import compare_signature, load_public_key
    from dpr_lab.planning.limits import PlanLimits

    trusted = load_public_key(signed_by) if signed_by else None
    certificate, current = load_certificate(path), made_with()
    lines = [
        *certificate.compare_seal(),
        *compare_signature(certificate, trusted),
        *compare_code(certificate.made_with, current, other_code=other_code, same_libraries=same_libraries),
        *(compare_recording(recording, path.parent) for recording in certificate.recordings),
        compare_rig(certificate, path.parent),
        *compare_limits(certificate, path.parent),
    ]
    if all(line.holds for line in lines):
        lines += compare_truncated(certificate, path.parent)
    if all(line.holds for line in lines):
        request = _request(certificate, path.parent)
        requirements = load_limits(path.parent / certificate.limits.file, PlanLimits) if certificate.limits else None
        diagnosis = diagnose(request, on_event).diagnosis
        lines += compare_claims(certificate.claims, diagnosis, _accepted(diagnosis, requirements, request))
    return VerifiedCertificate(choices_of(certificate), origin_of(certificate, current), lines)


def _request(certificate: "Certificate", folder: Path) -> DiagnoseRequest:
    choices: dict[str, Any] = dict(certificate.choices)
    runs, held_out = (certificate.runs(folder, held_out=role) for role in (False, True))
    return DiagnoseRequest(runs, certificate.rig_in(folder), held_out, **choices)
