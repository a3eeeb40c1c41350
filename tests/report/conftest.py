"""The diagnosis that is reported."""

import diagnosis_made
import pytest

from klute_sim.diagnose.diagnosis import Diagnosis
from klute_sim.report import diagnosis_page as page


@pytest.fixture(scope="session")
def found(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    return diagnosis_made.diagnosed(tmp_path_factory.mktemp("bench"))


@pytest.fixture(scope="session")
def plain(found: Diagnosis) -> str:
    return page.render_page(found, {})
