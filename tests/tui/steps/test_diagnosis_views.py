"""Step 6: next steps of a diagnosis that recommends checks."""

import io

from rich.console import Console

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.angles import RADIANS
from dpr_lab.tui.steps.diagnosis_views import next_view
from tests.a_diagnosis import made


def test_recommended_checks_are_shown_with_expected_results_and_the_command_that_records_them() -> None:
    def drawn(diagnosis: Diagnosis) -> str:
        page = io.StringIO()
        Console(width=76, file=page).print(next_view(diagnosis, RADIANS, "a [b]/diagnosis.json"))
        return " ".join(page.getvalue().split())

    shown = drawn(made())
    assert "check 1-abcd kind: measurement action: Compare ten minutes" in shown
    assert "expected result: 0.505 % (0.495 to 0.515)" in shown
    assert "To record the result: dpr-lab check 'a [b]/diagnosis.json' CHECK, followed by --value" in shown
    without = drawn(made(checks=[]))
    assert "expected result:" not in without
    assert "To record" not in without
