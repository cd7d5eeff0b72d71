"""Definition of the protocol in dpr.dbc: text, hash, version and messages."""

import hashlib
from importlib import resources

from cantools.database import load_string
from cantools.database.can import Database

DBC_TEXT = resources.files("firmware_protocol").joinpath("dpr.dbc").read_text(encoding="ascii")


def schema_hash(dbc_text: str) -> int:
    """Compute the first four bytes of the SHA-256 of a DBC with LF line ends, as a big-endian integer."""
    canonical = "\n".join(dbc_text.splitlines()) + "\n"
    return int.from_bytes(hashlib.sha256(canonical.encode("ascii")).digest()[:4], "big")


def _load(text: str) -> Database:
    database = load_string(text, database_format="dbc")
    assert isinstance(database, Database)
    return database


def _version(database: Database) -> tuple[int, int]:
    major, minor = (database.version or "").split(".")
    return int(major), int(minor)


DATABASE = _load(DBC_TEXT)
SCHEMA_HASH = schema_hash(DBC_TEXT)
PROTOCOL_VERSION = _version(DATABASE)
"""Major and minor version."""
