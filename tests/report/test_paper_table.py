"""A table for a paper: cells, and LaTeX that a parser of tables accepts."""

import re
import xml.etree.ElementTree as ET

from hugwbc.evaluation.episode import Settings
from hugwbc.evaluation.experiment import Result
from hugwbc.evaluation.figures import Difference, Figure
from hugwbc.evaluation.intervals import Estimate
from hugwbc.evaluation.tables import Table, figure_tables
from hugwbc.report.paper_table import _pages, tex_table, tex_text, write_paper

PAIR = Difference("qp", Estimate(-0.0123, -0.02, -0.004, 8))
SHARE = Difference("qp", Estimate(-37.5, None, None, 8), 0.25)


def result(controller, value, share, pair=None, of_share=None):
    table, first = "Walk & stop, 100 %", Estimate(value, value - 0.01, value + 0.01, 8)
    figures = [
        Figure(table, "E_vx_low", "m/s²", first, 0.03, controller=controller, difference=pair),
        Figure(
            table,
            "success",
            "% of episodes",
            Estimate(share, 30.0, 99.0, 8),
            controller=controller,
            difference=of_share,
        ),
        Figure("Falls", "worst", "m", Estimate(2.0, None, None, 8), controller=controller),
        Figure("Falls", "nobody has it", "s", Estimate(None, None, None, 0), controller=controller),
    ]
    return Result("mine", controller, Settings(), [], [], figures)


RESULTS = [result("qp", 0.05, 100.0), result("my_{own}", 0.0377, 62.5, PAIR, SHARE)]
TABLES = figure_tables(figure for result in RESULTS for figure in result.figures)


def cells(row):
    return re.split(r"(?<!\\)&", row)


def test_the_latex_is_balanced_and_every_row_has_every_cell():
    text = tex_table(TABLES, ["Seed 3, p < 0.05; 95 % of #2 ~ x^2 \\ $."])
    plain = re.sub(r"\\[\\&%$#_{}]", "", text)  # escaped characters
    assert plain.count("{") == plain.count("}") and plain.count("$") % 2 == 0 and "#" not in plain
    begun, ended = (re.findall(rf"\\{word}{{(\w+)}}", text) for word in ("begin", "end"))
    assert begun == ["table", "tabular"] and ended == begun[::-1]
    (columns,) = re.findall(r"\\begin{tabular}{@{}.*p{12em}(r+)@{}}", text)
    body = text.partition("\\toprule")[2].partition("\\bottomrule")[0].replace("\\midrule", "")
    rows = [row for row in body.split(r"\\") if row.strip()]
    assert len(rows) == 2 + 4 + 1 and {len(cells(row)) for row in rows} == {1 + len(columns)} == {4}
    headings = [[cell.strip() for cell in cells(row)[1:]] for row in rows if r"\_\{own\}" in row]
    assert headings == [["HugWBC, paper", "qp", r"my\_\{own\}"], ["", "qp", r"my\_\{own\}"]], "one column for each"
    assert not re.search(r"(?<!\\)%", text.split("\n", 1)[1]), "nothing is a comment but the first line"
    assert text.isascii(), "no character needs a font"
    pages = tex_table(TABLES * 30, ["Many."]).split(r"\begin{table}")[1:]
    assert len(pages) > 2 and all(r"\end{table}" in page and page.count(r" \\") < 60 for page in pages)
    assert tex_text("-0.5 to x-ray_1 <") == r"$-$0.5 to x-ray\_1 $<$"


def test_long_tables_and_long_labels_go_on_on_the_next_page():
    label = "speed at the ground, at most [m/s]"  # two lines
    rows = [[name, float(number)] for number in range(50) for name in (f"{number} {label}", "  minus qp")]
    pages = _pages([Table("faults", ["", "qp"], rows), Table("short", ["", "qp"], rows[:2])], 40)
    assert [row for page in pages for table in page for row in table.rows] == [*rows, *rows[:2]], "nothing is lost"
    assert len(pages) > 3 and all(not table.rows[0][0].startswith(" ") for page in pages for table in page)
    for number, page in enumerate(pages):
        lines = sum(2 + sum(1 + (len(row[0]) > 22) for row in table.rows) for table in page)
        assert lines <= (45 if number else 40)
    assert [table.title for table in pages[-1]] == ["faults", "short"]


def test_what_is_written(tmp_path):
    paths = write_paper(tmp_path, RESULTS, TABLES, ["A note."])
    assert [path.name for path in paths] == ["table.tex", "figures.csv", "figure.svg"]
    assert "my_{own},measured,0.0377" in (tmp_path / "figures.csv").read_text()
    root = ET.fromstring((tmp_path / "figure.svg").read_text())
    texts = ["".join(node.itertext()).strip() for node in root.iter("{http://www.w3.org/2000/svg}text")]
    assert {"paired difference from qp", "qp", "my_{own}"} <= set(texts) and root.get("width")
    assert not any("worst" in text for text in texts), "it has no interval"
