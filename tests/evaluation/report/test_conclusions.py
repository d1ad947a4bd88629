from hugwbc.evaluation.report.conclusions import conclusions
from hugwbc.evaluation.report.figures import Figure
from hugwbc.evaluation.report.statistics import Estimate


def figure(controller, quantity, value, paper=None, table="Walking"):
    return Figure(table, quantity, "m", controller, Estimate(value, 0.9 * value, 1.1 * value, 8), paper)


def test_conclusions_follow_from_the_figures():
    figures = [
        figure("learned", "E_h", 0.5, 1.0), figure("qp", "E_h", 0.2, 1.0),
        figure("learned", "E_p", 3.0, 1.0), figure("qp", "E_p", 3.1, 1.0),
        figure("learned", "E_w", 1.0), figure("qp", "E_w", 2.0),
    ]  # fmt: skip
    assert conclusions(figures, "learned", "qp") == [
        "Against the paper, learned is as good or better in 1 of 2 figures, worse in 1, of which 0 by less than the "
        "uncertainty. Furthest behind: E_p (Walking) × 3.",
        "Against the paper, qp is as good or better in 1 of 2 figures, worse in 1, of which 0 by less than the "
        "uncertainty. Furthest behind: E_p (Walking) × 3.1.",
        "Walking: learned is better in E_w; qp in E_h; 1 of 3 figures are not told apart.",
        "In all 3 figures that both have, learned is better in 1, qp in 1; 1 are not told apart.",
    ]


def test_other_figures_give_other_conclusions():
    figures = [figure("learned", f"E_{n}", 2.0) for n in range(6)] + [figure("qp", f"E_{n}", 1.0) for n in range(6)]
    assert conclusions(figures, "learned", "qp")[0] == "Walking: qp is better in E_0, E_1, E_2, E_3 and 2 more."
    assert conclusions(figures[:6], "learned", "learned")[-1].endswith("6 are not told apart.")
    assert conclusions([], "learned", "qp") == []
