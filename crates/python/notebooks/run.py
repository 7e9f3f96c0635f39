"""Runs a notebook to its end in a folder, and writes it there with its outputs: run.py NOTEBOOK FOLDER."""

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

path, folder = Path(sys.argv[1]), Path(sys.argv[2])
notebook = nbformat.read(path, as_version=4)
if any(cell.get("outputs") for cell in notebook.cells):
    sys.exit(f"{path} has outputs: clear them before it is committed")
NotebookClient(notebook, timeout=1200, kernel_name="python3", resources={"metadata": {"path": str(folder)}}).execute()
nbformat.write(notebook, folder / path.name)
print(f"{path}: {sum(cell.cell_type == 'code' for cell in notebook.cells)} cells of code ran")
