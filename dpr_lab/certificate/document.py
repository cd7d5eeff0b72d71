"""The certificate file: recordings, rig, choices, code and claims of one diagnosis.

The file contains no tolerances and no rules. These are part of the code (`dpr_lab.certificate.policy`). The seal is a
hash without a key. It detects damage and accidental edits, but anyone can compute it again after a deliberate edit.
"""

import hashlib
import json
import os
from pathlib import Path
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from dpr_lab.certificate.lines import Verified
from dpr_lab.configs import first_fault
from dpr_lab.effects import EFFECTS
from dpr_lab.errors import RunError
from dpr_lab.whole_file import not_json, regular

Policy = Literal[2]
POLICY: Policy = get_args(Policy)[0]
"""Version of the policy: claims, tolerances and permitted choices. It increases with every change of these rules.

The computation of a claim is not part of the policy: the hash of the code identifies it, and a verification repeats it.
"""

WRITER = "`dpr-lab certify`"
"""Command that writes certificates."""


def _path(text: str) -> str:
    """Validate the text of a file path.

    Raises:
        ValueError: the text cannot be a path.
    """
    if "\0" in text or any(len(os.fsencode(part)) > 255 for part in Path(text).parts):
        raise ValueError("is not a path")
    return text


FilePath = Annotated[str, Field(min_length=1, max_length=4000), AfterValidator(_path)]
Version = Annotated[str, Field(min_length=1, max_length=100)]
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class _Part(BaseModel):
    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, defer_build=True, populate_by_name=True, allow_inf_nan=False
    )


class CertifiedRecording(_Part):
    """A recording of a certificate."""

    file: FilePath
    """Path relative to the folder of the certificate."""
    sha256: Sha256
    """Hash of the file. Importing the same table again gives a file with another hash."""
    readings: Sha256
    """Hash of all data of the run that a fit uses (`dpr_lab.run.Run.readings_sha256`)."""
    held_out: bool
    """Whether the run was not fitted and only validated the diagnosis."""


class CertifiedRig(_Part):
    """Rig file of a certificate."""

    file: FilePath
    """Path relative to the folder of the certificate, or the name of a built-in rig."""
    sha256: Sha256
    """Hash of the file."""


class CertifiedLimits(_Part):
    """Limits file of the acceptance test in a certificate."""

    file: FilePath
    """Path relative to the folder of the certificate."""
    sha256: Sha256
    """Hash of the file."""


class CertifiedChoices(_Part):
    """Free choices of the diagnosis, which `verify` prints first."""

    library: Annotated[tuple[str, ...], Field(min_length=1)] | None
    """Names of the candidate effects; None: all."""
    without: tuple[str, ...]
    """Names of excluded effects."""
    max_effects: int = Field(ge=1, le=8)
    """Maximum number of named effects."""
    seed: int = Field(ge=0, lt=1 << 63)
    """Seed of the bootstrap."""
    any_clock: bool
    """Whether runs are accepted if the clock of their device is less accurate than a crystal oscillator."""
    torque: Literal["measured", "commanded"] | None
    """Kind of torques to use for runs that contain both; None: measured."""

    @model_validator(mode="after")
    def _known_effects(self) -> Self:
        unknown = [name for name in (*(self.library or ()), *self.without) if name not in EFFECTS]
        if unknown:
            raise ValueError(f"no effect named {', '.join(map(repr, unknown))} in this version")
        return self


class MadeWith(_Part):
    """Code, libraries and machine that computed the claims."""

    dpr_lab: Annotated[str, Field(min_length=1, max_length=1000)]
    """Version of dpr-lab, and names and versions of the packages with plugins."""
    code: Sha256
    """Hash of all Python files of dpr-lab and of its plugins."""
    python: Version
    numpy: Version
    scipy: Version
    numba: Version
    machine: Version


class CertifiedClaim(_Part):
    """A claim of a certificate."""

    value: Annotated[str, Field(max_length=65536)] | float
    """Value of the claim: a text, or a number in SI units."""
    interval90: tuple[float, float] | None
    """90 % interval of a number; None for a text, or for a number without an interval."""


class Signature(_Part):
    """Signature of a certificate."""

    public_key: str = Field(pattern="^ssh-ed25519 [A-Za-z0-9+/]{68}$")
    """Public key of the signer in OpenSSH format, without comment."""
    value: str = Field(pattern="^[0-9a-f]{128}$")
    """Ed25519 signature of `Certificate.content`, in hexadecimal digits."""


class Certificate(_Part):
    """Claims of a diagnosis, with all data that a repetition requires."""

    policy: Policy
    recordings: list[CertifiedRecording] = Field(min_length=1)
    rig: CertifiedRig
    limits: CertifiedLimits | None = None
    """Limits file whose test results are also claimed; None if there are no limits."""
    truncated_recordings: tuple[FilePath, ...] | None = None
    """Recordings that were interrupted or damaged, and are used up to this point; None in a file of an older
    version."""
    choices: CertifiedChoices
    made_with: MadeWith
    claims: dict[str, CertifiedClaim]
    signature: Signature | None
    seal: str = ""
    """SHA-256 of `content`, which detects damage and accidental edits."""

    @model_validator(mode="after")
    def _has_a_fitted_run(self) -> Self:
        if all(recording.held_out for recording in self.recordings):
            raise ValueError("every recording is held out, so none is fitted")
        return self

    @property
    def content(self) -> bytes:
        """Canonical JSON of all fields except signature and seal.

        The fields `limits` and `truncated_recordings` are left out if they are missing.
        """
        absent = {name for name in ("limits", "truncated_recordings") if getattr(self, name) is None}
        fields = self.model_dump(mode="json", exclude={"signature", "seal"} | absent)
        return json.dumps(fields, sort_keys=True, separators=(",", ":")).encode()

    def sealed(self) -> Self:
        """Return a copy of the certificate with its seal."""
        return self.model_copy(update={"seal": hashlib.sha256(self.content).hexdigest()})

    def compare_seal(self) -> list[Verified]:
        """Verify the seal; the list is empty if the seal matches the content."""
        if self.seal == self.sealed().seal:
            return []
        return [Verified("seal", self.seal, None, False, "the certificate was changed after it was written")]

    def runs(self, folder: Path, *, held_out: bool) -> tuple[Path, ...]:
        """Return the paths of the fitted recordings or, with `held_out`, of the held-out recordings."""
        return tuple(folder / recording.file for recording in self.recordings if recording.held_out is held_out)

    def rig_in(self, folder: Path) -> str:
        """Return the path of the rig file, or the name of a built-in rig."""
        path = folder / self.rig.file
        return str(path) if path.is_file() else self.rig.file

    def to_text(self) -> str:
        """Return the content of the certificate file."""
        return self.model_dump_json(indent=1) + "\n"


def load_certificate(path: Path) -> Certificate:
    """Read a certificate of at most 16 MB.

    The certificate of a thousand recordings is smaller than 1 MB.

    Raises:
        RunError: the file cannot be read, is not a certificate, or belongs to another policy.
    """
    try:
        if regular(path, RunError).stat().st_size > 16 << 20:
            raise RunError(f"{path}: is not a certificate: larger than 16 MB")
        text = path.read_text(encoding="utf-8")
        document = json.loads(text, object_pairs_hook=_without_repeated_keys)
        _refuse_other_policies(path, document)
        return Certificate.model_validate_json(text)
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}; give the file that {WRITER} has written") from error
    except ValidationError as error:
        fault = f"is not a valid certificate of policy {POLICY}: {first_fault(error)}"
        raise RunError(f"{path}: {fault}; give the file that {WRITER} has written") from error
    except (ValueError, RecursionError) as error:
        raise RunError(f"{path}: {not_json(error, 'a certificate', 'certificate.json', WRITER)}") from error


def _without_repeated_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Convert key-value pairs to a mapping, and refuse repeated keys.

    A person may read the first value of a repeated key, whereas programs use the last value.
    """
    values: dict[str, Any] = {}
    for key, value in pairs:
        if key in values:
            raise ValueError(f"key {key!r} occurs twice")
        values[key] = value
    return values


def _refuse_other_policies(path: Path, document: Any) -> None:
    if not isinstance(document, dict) or not document.keys() & {"policy", "schema"}:
        raise RunError(f"{path}: is not a certificate: give the file that {WRITER} has written")
    if "policy" not in document and document.get("schema") == 1:
        raise RunError(
            f"{path}: is a certificate of policy 1 (dpr-lab 0.2). Its tolerances are in the file, where they can be"
            f" edited. This version verifies policy {POLICY}. Certify the recordings again, or verify with dpr-lab 0.2"
        )
    policy = document.get("policy")
    if isinstance(policy, int) and not isinstance(policy, bool) and policy != POLICY:
        remedy = "Update dpr-lab" if policy > POLICY else "Certify the recordings again"
        raise RunError(f"{path}: is a certificate of policy {policy}, but this version verifies {POLICY}. {remedy}")
