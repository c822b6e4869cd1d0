"""Real logs of public repositories: none is read wrongly without a warning."""

import pytest

from . import real_logs


@pytest.mark.skipif(not real_logs.entries(), reason="needs the logs behind JAXCAL_REFERENCE")
@pytest.mark.parametrize("entry", real_logs.entries(), ids=lambda entry: entry["file"])
def test_a_real_log_is_read_rightly_or_refused_usefully(entry):
    outcome, said = real_logs.judge(entry)
    assert outcome == {"read": "read", "refuse": "refused"}[entry["expect"]], said
