"""Hashes of the files of a certificate: recordings, rig file and limits file."""

import os
from collections.abc import Iterable
from pathlib import Path

from dpr_lab.certificate.document import Certificate, CertifiedLimits, CertifiedRecording, CertifiedRig
from dpr_lab.certificate.lines import Verified
from dpr_lab.configs import sha256_of
from dpr_lab.errors import ConfigError, RunError
from dpr_lab.rig import load_rig
from dpr_lab.storage.reader import load_run


def certify_recording(path: Path, folder: Path, *, held_out: bool) -> CertifiedRecording:
    """Hash a run file for a certificate in a folder.

    Raises:
        RunError: the file is not a run.
    """
    readings = load_run(path).readings_sha256
    return CertifiedRecording(
        file=_relative(path, folder), sha256=sha256_of(path), readings=readings, held_out=held_out
    )


def certify_rig(rig: str, folder: Path) -> CertifiedRig:
    """Hash a rig file, or a built-in rig, for a certificate in a folder.

    Raises:
        ConfigError: the rig is not valid.
    """
    path = Path(rig)
    return CertifiedRig(file=_relative(path, folder) if path.is_file() else rig, sha256=load_rig(rig).sha256)


def certify_limits(path: Path, folder: Path) -> CertifiedLimits:
    """Hash a limits file for a certificate in a folder."""
    return CertifiedLimits(file=_relative(path, folder), sha256=sha256_of(path))


def compare_limits(certificate: Certificate, folder: Path) -> list[Verified]:
    """Compare the limits file with its certified hash.

    The list is empty if the certificate has no limits.
    """
    if certificate.limits is None:
        return []
    path, certified = folder / certificate.limits.file, certificate.limits.sha256
    if not path.is_file():
        return [Verified(certificate.limits.file, certified[:12], None, False, "does not exist")]
    sha256 = sha256_of(path)
    reason = "" if sha256 == certified else "is not the certified file"
    return [Verified(certificate.limits.file, certified[:12], sha256[:12], sha256 == certified, reason)]


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()


def compare_recording(certified: CertifiedRecording, folder: Path) -> Verified:
    """Compare a run file with its hashes.

    Equal hashes of the readings are sufficient, because importing the same table again gives another file with the same
    readings.
    """
    try:
        holds, sha256, reason = _compare(certified, folder / certified.file)
    except RunError as error:
        holds, sha256, reason = False, None, str(error)
    except OSError as error:
        holds, sha256, reason = False, None, f"cannot be read: {error.strerror}"
    return Verified(certified.file, certified.sha256[:12], sha256, holds, reason)


def _compare(certified: CertifiedRecording, path: Path) -> tuple[bool, str | None, str]:
    """Compare a file with the certified recording; return whether they agree, the hash, and the reason if not."""
    if not path.is_file():
        return False, None, "does not exist"
    sha256 = sha256_of(path)
    same_file = sha256 == certified.sha256
    if not same_file and not _has_readings(path, certified.readings):
        return False, sha256[:12], "is not the certified file"
    if same_file and load_run(path).readings_sha256 != certified.readings:
        return False, sha256[:12], "does not contain the certified readings"
    return True, sha256[:12], "" if same_file else "another file with the same readings"


def truncated_recordings(recordings: Iterable[CertifiedRecording], folder: Path) -> tuple[str, ...]:
    """Return the files of recordings that were interrupted or damaged."""
    return tuple(recording.file for recording in recordings if not load_run(folder / recording.file).complete)


def compare_truncated(certificate: Certificate, folder: Path) -> list[Verified]:
    """Compare the truncated recordings with the certified list; the result is empty if both agree."""
    certified, now = certificate.truncated_recordings, truncated_recordings(certificate.recordings, folder)
    if (certified or ()) == now:
        return []
    if certified is None:
        return [Verified("truncated recordings", None, ", ".join(now), True, "the certificate does not state them")]
    reason = "the certificate names other truncated recordings"
    return [Verified("truncated recordings", ", ".join(certified), ", ".join(now), False, reason)]


def _has_readings(path: Path, readings: str) -> bool:
    try:
        return load_run(path).readings_sha256 == readings
    except RunError:
        return False


def compare_rig(certificate: Certificate, folder: Path) -> Verified:
    """Compare the rig file with its hash.

    Raises:
        ConfigError: the file does not exist or is not valid.
    """
    try:
        sha256, certified = load_rig(certificate.rig_in(folder)).sha256, certificate.rig.sha256
    except OSError as error:
        raise ConfigError(f"{certificate.rig.file}: cannot be read: {error.strerror}") from error
    reason = "" if sha256 == certified else "is not the certified file"
    return Verified(certificate.rig.file, certified[:12], sha256[:12], sha256 == certified, reason)
