"""A new export format, kind of check or kind of table requires one file and one table entry."""

import json

import pytest

from tests.a_diagnosis import made
from tests.extension.conftest import Copy, outputs

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def printed(copy: Copy) -> dict[str, str]:
    """Output of the program of each extension."""
    return outputs(copy, {"export format": export_format, "kind of check": kind_of_check, "kind of file": kind_of_file})


def export_format(copy: Copy) -> str:
    copy.add(
        "dpr_lab/exports/parameter_list.py",
        '''
        """The parameters of the corrected model, one line each."""


        def parameter_list(model, rig, lost):
            return {"parameters.txt": "".join(f"{name} {p.value!r}\\n" for name, p in model.parameters.items())}
        ''',
    )
    copy.row(
        "dpr_lab/exports/__init__.py",
        "FORMATS",
        '"list": ExportFormat("parameter list", "parameters.txt", parameter_list, in_python)',
        "from dpr_lab.exports.parameter_list import parameter_list",
    )
    return """
        from dpr_lab.cli.checks import EXPORT_NAMES
        from dpr_lab.exports import FORMATS
        from dpr_lab.identification.model import Model, ParameterValue
        from dpr_lab.rig import load_rig

        values = {"m1": ParameterValue(value=0.1, std=None, fixed_by="measured")}
        model = Model.model_construct(parameters=values, effects={})
        print(EXPORT_NAMES.check("parameter list"), FORMATS["list"].written(model, load_rig("paper")))
        """


def test_an_export_format_is_a_file_and_a_row(printed: dict[str, str]) -> None:
    assert printed["export format"] == "list {'parameters.txt': 'm1 0.1\\n'}\n"


def kind_of_check(copy: Copy) -> str:
    copy.add(
        "dpr_lab/gap/advice/observation.py",
        '''
        """A yes or a no as a check: whether the swing sounds different."""

        import math

        from dpr_lab.errors import RunError
        from dpr_lab.gap.advice.check_kind import Result
        from dpr_lab.gap.result.checks import NONE_OF_THEM


        def form(check):
            return "--value yes or --value no"


        def propose(question, proposed):
            return [question.check("observation", "Listen to the joints.", question.causes, 0.5)]


        def result(diagnosis, check, answer, prior):
            if answer.value not in ("yes", "no"):
                raise RunError(f"check {check.id}: give {form(check)}, not {answer.value!r}")
            densities = {name: 0.01 for name in (*prior, NONE_OF_THEM)} | {check.about: 0.99}
            return Result(answer.value, {name: math.log(density) for name, density in densities.items()})
        ''',
    )
    copy.row(
        "dpr_lab/gap/advice/advise.py",
        "CHECK_KINDS",
        '"observation": CheckKind(frozenset({"value"}), observation.form, observation.propose, observation.result)',
        "from dpr_lab.gap.advice import observation",
    )
    diagnosis = made().to_json()
    diagnosis["checks"][0]["kind"] = "observation"
    (copy.folder / "diagnosis.json").write_text(json.dumps(diagnosis), encoding="utf-8")
    return """
        from pathlib import Path
        from dpr_lab.errors import RunError
        from dpr_lab.gap.result.diagnosis import load_diagnosis
        from dpr_lab.report.gap.check_tables import how_to_record
        from dpr_lab.workflows.check import take_check

        print(how_to_record(load_diagnosis(Path("diagnosis.json")), "d.json"))
        done = take_check(Path("diagnosis.json"), "1-abcd", value="yes").checks_done[0]
        print(done.result, done.after[done.check.about] > 0.9 > done.before[done.check.about])
        try:
            take_check(Path("diagnosis.json"), "1-abcd", value="1 mm", std="1")
        except RunError as error:
            print(error)
        """


def test_a_kind_of_check_is_a_file_and_a_row(printed: dict[str, str]) -> None:
    assert printed["kind of check"].startswith("To record the result: dpr-lab check d.json CHECK, followed by ")
    assert "--value yes or --value no (observation)" in printed["kind of check"]
    assert "\nyes True\n" in printed["kind of check"]
    assert "give its result, --value yes or --value no" in printed["kind of check"]


def kind_of_file(copy: Copy) -> str:
    copy.add(
        "dpr_lab/storage/readers/reversed_text.py",
        '''
        """Numbers written from the right to the left."""

        import numpy as np

        from dpr_lab.storage.readers.arrays import table_of


        def read_reversed(path, take):
            rows = [line[::-1].split() for line in path.read_text().splitlines()[1:]]
            values = zip(("t", "theta1", "theta2"), np.array(rows, dtype=float).T)
            return table_of(path, "reversed text", dict(values), take)
        ''',
    )
    copy.row(
        "dpr_lab/storage/readers/__init__.py",
        "READERS",
        'Reader("reversed text", (b"REVERSED",), read_reversed)',
        "from dpr_lab.storage.readers.reversed_text import read_reversed",
    )
    return """
        from pathlib import Path
        from dpr_lab.rig import load_rig
        from dpr_lab.storage.csv_import import ImportOptions
        from dpr_lab.storage.tables.understand import understand
        lines = [f"{k / 100} {3 + k / 200} {3 + k / 100}"[::-1] for k in range(50)]
        (file := Path("a.rev")).write_text("\\n".join(["REVERSED", *lines]))
        found = understand(file, load_rig("paper"), ImportOptions())
        print(found.kind, len(found.t), found.rate_hz, found.theta[-1, 2])
        """


def test_a_kind_of_file_to_import_is_a_file_and_a_row(printed: dict[str, str]) -> None:
    assert printed["kind of file"] == "reversed text 50 100.0 3.49\n"
