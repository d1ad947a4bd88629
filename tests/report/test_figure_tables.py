import csv
import io

from hugwbc.report.figures import Figure
from hugwbc.report.written import COLUMNS, figures_csv

from hugwbc.evaluation.intervals import Estimate


def test_every_figure_is_a_line_with_its_source():
    measured = Figure("Walking, fast", "E_h", "m", "qp", Estimate(0.06, 0.05, 0.07, 8), 0.03)
    published = Figure("Walking, fast", "E_h", "m", "HOVER", None, published=0.27)
    alone = Figure("Walking, fast", "E_h", "m", "", None, 0.05, reference="trained with motions")
    rows = list(csv.DictReader(io.StringIO(figures_csv([measured, published, alone]))))
    assert tuple(rows[0]) == COLUMNS
    assert rows[0]["table"] == "Walking, fast" and rows[0]["source"] == "measured"
    numbers = {name: float(rows[0][name]) for name in ("value", "low", "high", "samples", "paper", "ratio")}
    assert numbers == {"value": 0.06, "low": 0.05, "high": 0.07, "samples": 8, "paper": 0.03, "ratio": 2.0}
    assert rows[0]["against_paper"] == "worse"
    assert rows[1]["source"] == "published" and rows[1]["value"] == "0.27"
    assert (rows[2]["source"], rows[2]["paper"], rows[2]["reference"]) == (
        "paper alone",
        "0.05",
        "trained with motions",
    )
    assert rows[1]["low"] == rows[1]["ratio"] == rows[1]["against_paper"] == ""
