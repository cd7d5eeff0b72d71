"""Ed25519 signatures of certificates, with the keys of OpenSSH or OpenSSL; the library is `cryptography`.

Private keys are read and never written.
"""

import base64
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.certificate.document import Certificate, Signature
from dpr_lab.certificate.lines import Verified
from dpr_lab.errors import ConfigError
from dpr_lab.whole_file import regular

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

CONTEXT = b"dpr-lab certificate\n"
"""Before what is signed, so that a signature of a certificate is a signature of nothing else."""

MISSING = "signatures need the library cryptography: pip install 'dpr-lab[signing]'"
MAKE_A_KEY = "make one with: ssh-keygen -t ed25519 -f my_key"


def load_private_key(path: Path, passphrase: Callable[[], str] | None = None) -> "Ed25519PrivateKey":
    """Read a private key in PEM or OpenSSH form.

    Args:
        path: the key file
        passphrase: asks for the passphrase of a protected key; None where nobody can be asked

    Raises:
        ConfigError: no such file, no Ed25519 private key, a wrong passphrase, or `cryptography` is not installed.
    """
    require_library()
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    data = _key_file(path)
    if b"PUBLIC KEY" in data or data.startswith(b"ssh-"):
        raise ConfigError(f"{path}: is a public key: --sign needs the private one")
    try:
        key = _private(data, None)
    except TypeError as error:  # protected
        if passphrase is None:
            raise ConfigError(f"{path}: is protected by a passphrase: run the command on a terminal") from error
        try:
            key = _private(data, passphrase().encode())
        except (ValueError, TypeError) as wrong:
            raise ConfigError(f"{path}: cannot be opened with this passphrase") from wrong
    except (ValueError, UnsupportedAlgorithm) as error:
        raise ConfigError(f"{path}: is not a private key in PEM or OpenSSH form; {MAKE_A_KEY}") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise ConfigError(f"{path}: is not an Ed25519 key; {MAKE_A_KEY}")
    return key


def _private(data: bytes, password: bytes | None) -> object:
    from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_ssh_private_key

    load = load_ssh_private_key if b"BEGIN OPENSSH PRIVATE KEY" in data else load_pem_private_key
    return load(data, password)


def load_public_key(path: Path) -> str:
    """Read a public key in PEM or OpenSSH form, as OpenSSH writes it, without its comment.

    Raises:
        ConfigError: no such file, no Ed25519 public key, or `cryptography` is not installed.
    """
    require_library()
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key, load_ssh_public_key

    data = _key_file(path)
    if b"PRIVATE KEY" in data:
        raise ConfigError(
            f"{path}: is a private key: give the public one, which ssh-keygen wrote to {path.name}.pub and openssl"
            f" writes with: openssl pkey -in {path.name} -pubout"
        )
    try:
        key = load_pem_public_key(data) if b"BEGIN PUBLIC KEY" in data else load_ssh_public_key(data)
    except (ValueError, UnsupportedAlgorithm) as error:
        raise ConfigError(f"{path}: is not a public key in PEM or OpenSSH form") from error
    if not isinstance(key, Ed25519PublicKey):
        raise ConfigError(f"{path}: is not an Ed25519 key")
    return _as_openssh(key)


def sign(certificate: Certificate, key: "Ed25519PrivateKey") -> Certificate:
    """The certificate with a signature of its content."""
    value = key.sign(CONTEXT + certificate.content).hex()
    signature = Signature(public_key=_as_openssh(key.public_key()), value=value)
    return certificate.model_copy(update={"signature": signature})


def is_valid(certificate: Certificate) -> bool:
    """Whether its signature is one of its content by the key that it names; `cryptography` is needed."""
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_ssh_public_key

    assert certificate.signature is not None
    try:
        key = load_ssh_public_key(certificate.signature.public_key.encode())
        assert isinstance(key, Ed25519PublicKey)
        key.verify(bytes.fromhex(certificate.signature.value), CONTEXT + certificate.content)
    except (ValueError, InvalidSignature):
        return False
    return True


def compare_signature(certificate: Certificate, trusted: str | None) -> list[Verified]:
    """Check the signature of a certificate; no line where there is none to check or nothing to check it with.

    Args:
        certificate: the certificate
        trusted: the public key that must have signed it, as `load_public_key` gives it; None: any or none
    """
    wanted = fingerprint(trusted) if trusted else None
    if certificate.signature is None:
        return [Verified("signature", None, wanted, False, "there is none")] if trusted else []
    if not installed():
        return []
    own = fingerprint(certificate.signature.public_key)
    if trusted and certificate.signature.public_key != trusted:
        return [Verified("signature", own, wanted, False, "is by another key")]
    if not is_valid(certificate):
        return [Verified("signature", own, wanted, False, "is not a signature of this content")]
    return [Verified("signature", own, wanted, True, "" if trusted else "by a key that nobody asked for")]


def fingerprint(public_key: str) -> str:
    """Of a key in the form of OpenSSH, as `ssh-keygen -lf` prints it."""
    digest = hashlib.sha256(base64.b64decode(public_key.split()[1])).digest()
    return "SHA256:" + base64.b64encode(digest).decode().rstrip("=")


def installed() -> bool:
    """Whether `cryptography` can be used."""
    try:
        require_library()
    except ConfigError:
        return False
    return True


def require_library() -> None:
    """Make sure that `cryptography` can be used.

    Raises:
        ConfigError: it cannot.
    """
    try:
        import cryptography.hazmat.primitives.asymmetric.ed25519  # noqa: F401
    except ImportError as error:
        raise ConfigError(MISSING) from error


def _as_openssh(key: "Ed25519PublicKey") -> str:
    from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

    return key.public_bytes(Encoding.OpenSSH, PublicFormat.OpenSSH).decode()


def _key_file(path: Path, max_bytes: int = 1 << 16) -> bytes:
    try:
        with regular(path, ConfigError).open("rb") as file:
            return file.read(max_bytes)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}; {MAKE_A_KEY}") from error
