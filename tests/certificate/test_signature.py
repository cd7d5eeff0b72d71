"""Signatures of certificates, with keys of OpenSSH and OpenSSL."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from dpr_lab.certificate import signature
from dpr_lab.certificate.document import Signature, load_certificate
from dpr_lab.certificate.signature import compare_signature, fingerprint, load_private_key, load_public_key, sign
from dpr_lab.errors import ConfigError, RunError
from dpr_lab.workflows.certify import VerifiedCertificate, certify, verify
from tests.certificate.conftest import request_of, reseal
from tests.certificate.test_edits import EACH, edits

pytest.importorskip("cryptography")
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
)

PASSPHRASE = "open sesame"


def write_key(path: Path, key: object, form: PrivateFormat, passphrase: str = "") -> Path:
    """Write a private key and its public key in the same form."""
    protection = BestAvailableEncryption(passphrase.encode()) if passphrase else NoEncryption()
    path.write_bytes(key.private_bytes(Encoding.PEM, form, protection))  # type: ignore[attr-defined]
    openssh = form is PrivateFormat.OpenSSH
    public = (Encoding.OpenSSH, PublicFormat.OpenSSH) if openssh else (Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    path.with_name(f"{path.name}.pub").write_bytes(key.public_key().public_bytes(*public))  # type: ignore[attr-defined]
    return path


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    where = tmp_path_factory.mktemp("keys")
    write_key(where / "ssh", Ed25519PrivateKey.generate(), PrivateFormat.OpenSSH)
    write_key(where / "pem", Ed25519PrivateKey.generate(), PrivateFormat.PKCS8)
    write_key(where / "ssh_protected", Ed25519PrivateKey.generate(), PrivateFormat.OpenSSH, PASSPHRASE)
    write_key(where / "pem_protected", Ed25519PrivateKey.generate(), PrivateFormat.PKCS8, PASSPHRASE)
    write_key(where / "ecdsa", ec.generate_private_key(ec.SECP256R1()), PrivateFormat.PKCS8)
    (where / "text").write_text("no key\n", encoding="utf-8")
    return where


@pytest.fixture
def signed(folder: Path, keys: Path) -> Path:
    path = folder / "signed.json"
    certificate = sign(load_certificate(folder / "certificate.json"), load_private_key(keys / "ssh"))
    path.write_text(certificate.to_text(), encoding="utf-8")
    return path


def signature_line(done: VerifiedCertificate) -> tuple[bool, str]:
    (line,) = (line for line in done.lines if line.claim == "signature")
    return line.holds, line.reason


@pytest.mark.slow
@pytest.mark.usefixtures("remembered")
@pytest.mark.parametrize("key", ["ssh", "pem", "ssh_protected", "pem_protected"])
def test_a_signed_certificate_holds_for_its_key_and_for_no_other(folder: Path, keys: Path, key: str) -> None:
    path = folder / "signed.json"
    made = certify(request_of(folder), path, sign_with=keys / key, passphrase=lambda: PASSPHRASE)
    assert made.certificate.signature is not None
    done = verify(path, signed_by=keys / f"{key}.pub")
    assert done.holds, done.lines
    assert signature_line(done) == (True, "")
    other = "pem" if key == "ssh" else "ssh"
    done = verify(path, signed_by=keys / f"{other}.pub")
    assert not done.holds
    assert signature_line(done) == (False, "was made with another key")
    shown = {each.name: each.value for each in verify(path).origin}["signature"]
    assert shown == f"by key {fingerprint(load_public_key(keys / f'{key}.pub'))}"


@pytest.mark.slow
def test_no_edit_of_a_signed_certificate_keeps_its_signature(signed: Path, keys: Path, folder: Path) -> None:
    original = load_certificate(signed)
    whole, trusted = json.loads(signed.read_text(encoding="utf-8")), load_public_key(keys / "ssh.pub")
    path = folder / "edited.json"
    tried = 0
    for key, edited in edits(whole, min(EACH, 2)):
        path.write_text(json.dumps(edited), encoding="utf-8")
        try:
            if load_certificate(path) == original or key == ("seal",):
                continue
            reseal(path)
            (line,) = compare_signature(load_certificate(path), trusted)
        except RunError:
            continue
        assert not line.holds, key
        tried += 1
    assert tried > 100


@pytest.mark.slow
def test_an_unsigned_certificate_fails_if_a_key_is_required(folder: Path, keys: Path) -> None:
    assert signature_line(verify(folder / "certificate.json", signed_by=keys / "ssh.pub")) == (False, "is missing")


@pytest.mark.slow
@pytest.mark.usefixtures("remembered")
def test_a_signature_is_verified_and_its_key_shown_if_no_key_is_required(signed: Path) -> None:
    assert signature_line(verify(signed)) == (True, "no key was required")
    certificate = load_certificate(signed)
    assert certificate.signature is not None
    forged = Signature(public_key=certificate.signature.public_key, value="0" * 128)
    signed.write_text(certificate.model_copy(update={"signature": forged}).to_text(), encoding="utf-8")
    assert signature_line(verify(signed)) == (False, "is not valid for this content")


def test_a_public_key_has_one_name_in_either_form(keys: Path) -> None:
    for name in ("ssh", "pem"):
        public = load_public_key(keys / f"{name}.pub")
        assert public.startswith("ssh-ed25519 ")
        commented = keys / "commented.pub"
        commented.write_text(f"{public} somebody@bench\n", encoding="utf-8")
        assert load_public_key(commented) == public


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing", "cannot be read: No such file or directory; create a key with: ssh-keygen"),
        (".", "cannot be read: Is a directory"),
        ("text", "is not a private key in PEM or OpenSSH form"),
        ("ssh.pub", "is a public key. --sign requires the private key"),
        ("pem.pub", "is a public key. --sign requires the private key"),
        ("ecdsa", "is not an Ed25519 key"),
        ("ssh_protected", "is protected by a passphrase. Run the command on a terminal"),
        ("pem_protected", "is protected by a passphrase. Run the command on a terminal"),
    ],
)
def test_a_key_that_cannot_sign_is_refused_before_the_diagnosis(
    folder: Path, keys: Path, tmp_path: Path, name: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        certify(request_of(folder), tmp_path / "c.json", sign_with=keys / name)
    assert not (tmp_path / "c.json").exists()


def test_a_protected_key_without_the_library_of_its_protection_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(data: bytes, password: bytes | None) -> object:
        raise TypeError("protected") if password is None else UnsupportedAlgorithm("Need bcrypt module")

    monkeypatch.setattr(signature, "_private", opened)
    (tmp_path / "key").write_text("key")
    with pytest.raises(ConfigError, match="Need bcrypt module"):
        load_private_key(tmp_path / "key", lambda: PASSPHRASE)


@pytest.mark.parametrize("name", ["ssh_protected", "pem_protected"])
def test_a_wrong_passphrase_is_refused(keys: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="cannot be opened with this passphrase"):
        load_private_key(keys / name, lambda: "wrong")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing", "cannot be read"),
        ("text", "is not a public key in PEM or OpenSSH form"),
        ("ssh", "is a private key. Give the public key"),
        ("pem", "is a private key. Give the public key"),
        ("ecdsa.pub", "is not an Ed25519 key"),
    ],
)
def test_a_key_that_cannot_verify_is_refused(signed: Path, keys: Path, name: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        verify(signed, signed_by=keys / name)


def test_private_keys_are_only_read(keys: Path) -> None:
    before = {path.name: path.read_bytes() for path in keys.iterdir()}
    load_private_key(keys / "ssh")
    assert {path.name: path.read_bytes() for path in keys.iterdir()} == before


WITHOUT_LIBRARY = """
import sys
sys.modules["cryptography"] = None
from pathlib import Path
from dpr_lab.certificate.declared import origin_of
from dpr_lab.certificate.code import made_with
from dpr_lab.certificate.document import load_certificate
from dpr_lab.certificate.signature import compare_signature, load_private_key, load_public_key
from dpr_lab.errors import ConfigError
for load in (load_private_key, load_public_key):
    try:
        load(Path("key"))
    except ConfigError as error:
        print(error)
certificate = load_certificate(Path(sys.argv[1]))
print(compare_signature(certificate, None), origin_of(certificate, made_with())[-1].note)
"""


@pytest.mark.slow
def test_without_the_library_the_message_states_how_to_install_it(signed: Path) -> None:
    command = [sys.executable, "-c", WITHOUT_LIBRARY, str(signed)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ)
    sentence = "signatures require the library cryptography: pip install 'dpr-lab[signing]'"
    assert done.stdout.splitlines() == [sentence, sentence, f"[] not checked: {sentence}"]
