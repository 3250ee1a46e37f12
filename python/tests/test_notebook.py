"""The notebook runs from its first cell to its last, and comes to what the program says."""

from pathlib import Path

import gaware
import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).resolve().parents[1] / "examples/flight.ipynb"


def test_the_notebook_leads_from_a_log_to_its_verdict(clean, monkeypatch):
    monkeypatch.setenv("GAWARE_LOG", str(clean))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "the notebook is kept without outputs"
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": NOTEBOOK.parent}}).execute()
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    texts = [str(output.get("text", output.get("data", {}).get("text/plain", ""))) for output in outputs]
    found = gaware.explain(clean)
    assert repr(found.verdict) in texts
    assert any(found.report["summary"] in text for text in texts)
    assert any(found.model.to_toml() in text for text in texts)
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 1
