"""Ed25519 signatures of certificates with keys of OpenSSH or OpenSSL, based on the library `cryptography`.

Private keys are read, but never created or written.
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
"""Prefix of the signed bytes, so that the signature is valid for a certificate only."""

MISSING = "signatures require the library cryptography: pip install 'dpr-lab[signing]'"
MAKE_A_KEY = "create a key with: ssh-keygen -t ed25519 -f my_key"


def load_private_key(path: Path, passphrase: Callable[[], str] | None = None) -> "Ed25519PrivateKey":
    """Read a private key in PEM or OpenSSH form.

    Args:
        path: the key file
        passphrase: function that asks for the passphrase of a protected key; None if there is no terminal

    Raises:
        ConfigError: the file does not exist or is not an Ed25519 private key, the passphrase is wrong, or
            `cryptography` is not installed.
    """
    require_library()
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    content = _key_file(path)
    if b"PUBLIC KEY" in content or content.startswith(b"ssh-"):
        raise ConfigError(f"{path}: is a public key. --sign requires the private key")
    try:
        key = _private(content, None)
    except TypeError as error:  # the key is protected by a passphrase
        if passphrase is None:
            raise ConfigError(f"{path}: is protected by a passphrase. Run the command on a terminal") from error
        try:
            key = _private(content, passphrase().encode())
        except (ValueError, TypeError) as wrong:
            raise ConfigError(f"{path}: cannot be opened with this passphrase") from wrong
        except UnsupportedAlgorithm as missing:  # the library lacks bcrypt, which OpenSSH keys need
            raise ConfigError(f"{path}: its protection is not supported: {missing}. {MISSING}") from missing
    except (ValueError, UnsupportedAlgorithm) as error:
        raise ConfigError(f"{path}: is not a private key in PEM or OpenSSH form; {MAKE_A_KEY}") from error
    if not isinstance(key, Ed25519PrivateKey):
        raise ConfigError(f"{path}: is not an Ed25519 key; {MAKE_A_KEY}")
    return key


def _private(content: bytes, password: bytes | None) -> object:
    from cryptography.hazmat.primitives.serialization import load_pem_private_key, load_ssh_private_key

    load = load_ssh_private_key if b"BEGIN OPENSSH PRIVATE KEY" in content else load_pem_private_key
    return load(content, password)


def load_public_key(path: Path) -> str:
    """Read a public key in PEM or OpenSSH form and return it in OpenSSH form.

    A comment in the key is removed.

    Raises:
        ConfigError: the file does not exist or is not an Ed25519 public key, or `cryptography` is not installed.
    """
    require_library()
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key, load_ssh_public_key

    data = _key_file(path)
    if b"PRIVATE KEY" in data:
        raise ConfigError(
            f"{path}: is a private key. Give the public key: ssh-keygen wrote it to {path.name}.pub; openssl writes it"
            f" with: openssl pkey -in {path.name} -pubout"
        )
    try:
        key = load_pem_public_key(data) if b"BEGIN PUBLIC KEY" in data else load_ssh_public_key(data)
    except (ValueError, UnsupportedAlgorithm) as error:
        raise ConfigError(f"{path}: is not a public key in PEM or OpenSSH form") from error
    if not isinstance(key, Ed25519PublicKey):
        raise ConfigError(f"{path}: is not an Ed25519 key")
    return _as_openssh(key)


def sign(certificate: Certificate, key: "Ed25519PrivateKey") -> Certificate:
    """Return a copy of a certificate with a signature of its content."""
    value = key.sign(CONTEXT + certificate.content).hex()
    signature = Signature(public_key=_as_openssh(key.public_key()), value=value)
    return certificate.model_copy(update={"signature": signature})


def is_valid(certificate: Certificate) -> bool:
    """Return whether the signature of a certificate matches its content and public key.

    The library `cryptography` must be installed.
    """
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
    """Verify the signature of a certificate.

    The list is empty in two cases: there is no signature and no key is required, or the signature cannot be verified
    because `cryptography` is missing.

    Args:
        certificate: the certificate
        trusted: the required public key, from `load_public_key`; None: any key, or no signature
    """
    required = fingerprint(trusted) if trusted else None
    if certificate.signature is None:
        return [Verified("signature", None, required, False, "is missing")] if trusted else []
    if not installed():
        return []
    key = fingerprint(certificate.signature.public_key)
    if trusted and certificate.signature.public_key != trusted:
        return [Verified("signature", key, required, False, "was made with another key")]
    if not is_valid(certificate):
        return [Verified("signature", key, required, False, "is not valid for this content")]
    return [Verified("signature", key, required, True, "" if trusted else "no key was required")]


def fingerprint(public_key: str) -> str:
    """Return the fingerprint of a key in OpenSSH form, as `ssh-keygen -lf` prints it."""
    digest = hashlib.sha256(base64.b64decode(public_key.split()[1])).digest()
    return "SHA256:" + base64.b64encode(digest).decode().rstrip("=")


def installed() -> bool:
    """Return whether `cryptography` is installed."""
    try:
        require_library()
    except ConfigError:
        return False
    return True


def require_library() -> None:
    """Check that `cryptography` is installed.

    Raises:
        ConfigError: `cryptography` is not installed.
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
