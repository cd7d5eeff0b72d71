"""The certificate file: recordings, rig, choices, code and claims of one diagnosis.

The file contains no tolerances and no rules; these are the policy of the code (`dpr_lab.certificate.policy`). The seal
is a hash without a key: it detects damage and accidental edits, but anyone can compute it again after an edit.
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
from dpr_lab.whole_file import regular

Policy = Literal[2]
POLICY: Policy = get_args(Policy)[0]
"""Version of claims, tolerances and permitted choices; it increases with every change of these rules."""

Number = Annotated[float, Field(allow_inf_nan=False)]


def _path(text: str) -> str:
    """Check that a text can be the path of a file."""
    if "\0" in text or any(len(os.fsencode(part)) > 255 for part in Path(text).parts):
        raise ValueError("is not a path")
    return text


FilePath = Annotated[str, Field(min_length=1, max_length=4000), AfterValidator(_path)]
Version = Annotated[str, Field(min_length=1, max_length=100)]
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, defer_build=True, populate_by_name=True)


class CertifiedRecording(_Part):
    """A recording of a certificate."""

    file: FilePath
    """Path relative to the folder of the certificate."""
    sha256: Sha256
    """Hash of the file. Importing the same table again gives another file."""
    readings: Sha256
    """`dpr_lab.run.Run.readings_sha256`: hash of everything that a fit uses of the run."""
    held_out: bool
    """Whether the run only validated the diagnosis and was not fitted."""


class CertifiedRig(_Part):
    """The rig file."""

    file: FilePath
    """Path relative to the folder of the certificate, or the name of a built-in rig."""
    sha256: Sha256
    """Hash of the file."""


class CertifiedLimits(_Part):
    """The limits file of an acceptance test."""

    file: FilePath
    """Path relative to the folder of the certificate."""
    sha256: Sha256
    """Hash of the file."""


class CertifiedChoices(_Part):
    """Free choices of the diagnosis; `verify` shows them first."""

    library: Annotated[tuple[str, ...], Field(min_length=1)] | None
    """Names of the candidate effects; None: all."""
    without: tuple[str, ...]
    """Names of excluded effects."""
    max_effects: int = Field(ge=1, le=8)
    """Maximum number of effects at once."""
    seed: int = Field(ge=0, lt=1 << 63)
    """Seed of the bootstrap."""
    any_clock: bool
    """Whether runs are accepted if their device clock is less accurate than a crystal."""
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
    """Version, and names and versions of the packages with plugins."""
    code: Sha256
    """Hash of all Python files of the package and of the plugins."""
    python: Version
    numpy: Version
    scipy: Version
    numba: Version
    machine: Version


class CertifiedClaim(_Part):
    """A claim of a certificate."""

    value: Annotated[str, Field(max_length=65536)] | Number
    """Text or number, SI."""
    interval90: tuple[Number, Number] | None
    """90 % interval; None for a text or a number without one."""


class Signature(_Part):
    """Signature of a certificate."""

    public_key: str = Field(pattern="^ssh-ed25519 [A-Za-z0-9+/]{68}$")
    """Key of the signer in OpenSSH form, without comment."""
    value: str = Field(pattern="^[0-9a-f]{128}$")
    """Ed25519 signature of `Certificate.content`, in hexadecimal digits."""


class Certificate(_Part):
    """Claims of a diagnosis with everything that is required to repeat it."""

    policy: Policy
    recordings: list[CertifiedRecording] = Field(min_length=1)
    rig: CertifiedRig
    limits: CertifiedLimits | None = None
    """Limits whose test results are claimed too; None if there are none."""
    choices: CertifiedChoices
    made_with: MadeWith
    claims: dict[str, CertifiedClaim]
    signature: Signature | None
    seal: str = ""
    """SHA-256 of `content`; detects damage and accidental edits."""

    @model_validator(mode="after")
    def _has_a_fitted_run(self) -> Self:
        if all(recording.held_out for recording in self.recordings):
            raise ValueError("every recording is held out, so none is fitted")
        return self

    @property
    def content(self) -> bytes:
        """Canonical JSON of everything except signature and seal; limits are left out if there are none."""
        absent = {"limits"} if self.limits is None else set[str]()
        fields = self.model_dump(mode="json", exclude={"signature", "seal"} | absent)
        return json.dumps(fields, sort_keys=True, separators=(",", ":")).encode()

    def sealed(self) -> Self:
        """Return a copy with its seal."""
        return self.model_copy(update={"seal": hashlib.sha256(self.content).hexdigest()})

    def compare_seal(self) -> list[Verified]:
        """One line if the seal does not match the content; otherwise none."""
        if self.seal == self.sealed().seal:
            return []
        return [Verified("seal", self.seal, None, False, "the certificate was changed after it was written")]

    def runs(self, folder: Path, *, held_out: bool) -> tuple[Path, ...]:
        """Paths of the fitted or of the held-out recordings."""
        return tuple(folder / recording.file for recording in self.recordings if recording.held_out is held_out)

    def rig_in(self, folder: Path) -> str:
        """Path of the rig file, or name of a built-in rig."""
        path = folder / self.rig.file
        return str(path) if path.is_file() else self.rig.file

    def to_text(self) -> str:
        """Text of the file."""
        return self.model_dump_json(indent=1) + "\n"


def load_certificate(path: Path) -> Certificate:
    """Read a certificate.

    Raises:
        RunError: the file cannot be read, is not a certificate, or is of another policy.
    """
    text = _text(path)
    try:
        document = json.loads(text, object_pairs_hook=_without_repeated_keys)
        _refuse_other_policies(path, document)
        return Certificate.model_validate_json(text)
    except ValidationError as error:
        raise RunError(f"{path}: is not a valid certificate of policy {POLICY}: {first_fault(error)}") from error
    except (ValueError, RecursionError) as error:
        raise RunError(f"{path}: is not a certificate (JSON): {error}") from error


def _text(path: Path, max_mb: int = 16) -> str:
    """Read a file of limited size; a certificate of a thousand recordings has less than 1 MB."""
    try:
        if regular(path, RunError).stat().st_size > max_mb << 20:
            raise RunError(f"{path}: is not a certificate: larger than {max_mb} MB")
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise RunError(f"{path}: is not a certificate: not text in UTF-8") from error


def _without_repeated_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse repeated keys: people may read the first value, programs use the last."""
    values: dict[str, Any] = {}
    for key, value in pairs:
        if key in values:
            raise ValueError(f"key {key!r} occurs twice")
        values[key] = value
    return values


def _refuse_other_policies(path: Path, document: Any) -> None:
    if not isinstance(document, dict):
        raise RunError(f"{path}: is not a certificate: not a JSON object")
    if "policy" not in document and document.get("schema") == 1:
        raise RunError(
            f"{path}: is a certificate of policy 1 (dpr-lab 0.2). Its tolerances are in the file, where they can be"
            f" edited. This version verifies policy {POLICY}. Certify the recordings again, or verify with dpr-lab 0.2"
        )
    policy = document.get("policy")
    if isinstance(policy, int) and not isinstance(policy, bool) and policy != POLICY:
        remedy = "Update dpr-lab" if policy > POLICY else "Certify the recordings again"
        raise RunError(f"{path}: is a certificate of policy {policy}, but this version verifies {POLICY}. {remedy}")
