"""The diagnosis that is reported."""

import pytest

from klute_sim.diagnosis.workflow import Diagnosis
from klute_sim.report.diagnosis import page
from tests.report import synthetic_diagnosis as diagnosis_made


@pytest.fixture(scope="session")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    return diagnosis_made.diagnosed(tmp_path_factory.mktemp("bench"))


@pytest.fixture(scope="session")
def plain(found: Diagnosis) -> str:
    return page.render_page(found, {})
