"""Write generated/ from dpr.dbc: cantools' pack and unpack functions, and the schema's hash and version.

python firmware_protocol/c/generate.py
"""

import re
from pathlib import Path

from cantools.database.can.c_source import generate

from firmware_protocol.definition import DATABASE, PROTOCOL_VERSION, SCHEMA_HASH

GENERATED = Path(__file__).with_name("generated")

SCHEMA = """\
/* Generated from dpr.dbc by generate.py. */
#ifndef DPR_SCHEMA_H
#define DPR_SCHEMA_H

#define DPR_PROTOCOL_MAJOR {major}u
#define DPR_PROTOCOL_MINOR {minor}u
#define DPR_SCHEMA_HASH 0x{schema_hash:08X}u

#endif
"""


def generated() -> dict[str, str]:
    """Generate the content of each file in generated/, by name."""
    header, source, _, _ = generate(DATABASE, "dpr", "dpr.h", "dpr.c", "dpr_fuzzer.c", floating_point_numbers=False)
    major, minor = PROTOCOL_VERSION
    return {
        "dpr.h": _undated(header),
        "dpr.c": _undated(source),
        "dpr_schema.h": SCHEMA.format(major=major, minor=minor, schema_hash=SCHEMA_HASH),
    }


def _undated(text: str) -> str:
    """Remove the date of creation from a generated file, because it would differ in every run."""
    return re.sub(r"(by cantools version [\d.]+) .*", r"\1.", text)


def main() -> None:
    """Write all files that differ from the generated content."""
    for name, text in generated().items():
        path = GENERATED / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            print(f"{path.name} written")


if __name__ == "__main__":
    main()
