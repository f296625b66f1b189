"""Runs a notebook from its first cell to its last, in its folder; prints what it printed, and the number of its pictures."""

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

path = Path(sys.argv[1])
notebook = nbformat.read(path, as_version=4)
cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
if any(cell.outputs or cell.execution_count for cell in cells):
    sys.exit(f"{path.name} has results of an earlier run: commit it without")
NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(path.parent)}}).execute()
outputs = [output for cell in cells for output in cell.outputs]
print("".join(output.text for output in outputs if output.output_type == "stream" and output.name == "stdout"), end="")
print(sum("image/png" in output.get("data", {}) for output in outputs), "pictures")
