"""Define the report sections that show the evidence; `SECTIONS` is their order on the page."""

from dpr_lab.report.gap.section import EvidenceSection
from dpr_lab.report.gap.sections.budget import BUDGET
from dpr_lab.report.gap.sections.closing import CLOSING
from dpr_lab.report.gap.sections.curves import CURVES
from dpr_lab.report.gap.sections.domain import DOMAIN
from dpr_lab.report.gap.sections.exclusions import EXCLUSIONS
from dpr_lab.report.gap.sections.friction import FRICTION
from dpr_lab.report.gap.sections.metric import METRIC
from dpr_lab.report.gap.sections.provenance import PROVENANCE
from dpr_lab.report.gap.sections.residuals import RESIDUALS
from dpr_lab.report.gap.sections.trust import TRUST

SECTIONS: tuple[EvidenceSection, ...] = (
    CURVES,
    CLOSING,
    BUDGET,
    FRICTION,
    METRIC,
    RESIDUALS,
    DOMAIN,
    EXCLUSIONS,
    TRUST,
    PROVENANCE,
)
