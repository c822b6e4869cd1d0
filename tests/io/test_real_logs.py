"""Real logs of public repositories: none is read wrongly without a warning."""

import importlib.util
import pathlib

import pytest

_SPEC = importlib.util.spec_from_file_location("real_logs", pathlib.Path(__file__).with_name("real_logs.py"))
real_logs = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(real_logs)


@pytest.mark.skipif(not real_logs.entries(), reason="needs the logs behind JAXCAL_REFERENCE")
@pytest.mark.parametrize("entry", real_logs.entries(), ids=lambda entry: entry["file"])
def test_a_real_log_is_read_rightly_or_refused_usefully(entry):
    outcome, said = real_logs.judge(entry)
    assert outcome == {"read": "read", "refuse": "refused"}[entry["expect"]], said
