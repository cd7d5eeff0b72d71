"""Define the JSON Schemas of the results."""

from dpr_lab.report.schemas.generate import schema
from dpr_lab.report.schemas.printed import SCHEMAS

__all__ = ["SCHEMAS", "schema"]
