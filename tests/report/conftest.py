"""Fixtures of a diagnosis and of its page without figures."""

import pytest

from klute_sim.diagnosis.result import Diagnosis
from klute_sim.report.diagnosis import page
from tests.report.synthetic_diagnosis import diagnose_synthetic_dataset


@pytest.fixture(scope="session")
def diagnosis(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    return diagnose_synthetic_dataset(tmp_path_factory.mktemp("bench"))


@pytest.fixture(scope="session")
def html(diagnosis: Diagnosis) -> str:
    return page.render_page(diagnosis, {})
