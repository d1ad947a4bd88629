from hugwbc.evaluation.figures import Figure
from hugwbc.evaluation.intervals import Estimate
from hugwbc.report.conclusions import THE_TEACHER, conclusions, duel_table, provenance


def figure(controller, quantity, value, paper=None, table="Walking"):
    return Figure(table, quantity, "m", controller, Estimate(value, 0.9 * value, 1.1 * value, 8), paper)


def test_conclusions_follow_from_the_figures():
    figures = [
        figure("learned", "E_h", 0.5, 1.0), figure("qp", "E_h", 0.2, 1.0),
        figure("learned", "E_p", 3.0, 1.0), figure("qp", "E_p", 3.1, 1.0),
        figure("learned", "E_w", 1.0), figure("qp", "E_w", 2.0),
    ]  # fmt: skip
    assert conclusions(figures, "learned", "qp") == [
        "Against the paper, learned is as good or better in 1 of 2 figures, worse in 1 (0 of them by less than the "
        "uncertainty). Furthest behind: E_p [m] (Walking) × 3, 3 against 1.",
        "Against the paper, qp is as good or better in 1 of 2 figures, worse in 1 (0 of them by less than the "
        "uncertainty). Furthest behind: E_p [m] (Walking) × 3.1, 3.1 against 1.",
        "In all 3 figures that both have, learned is better in 1, qp in 1; 1 too close to call.",
    ]


def test_tables_in_which_they_meet():
    figures = [
        figure("learned", "E_h", 0.5), figure("qp", "E_h", 0.2),
        figure("learned", "E_p", 1.0), figure("qp", "E_p", 2.0),
        figure("learned", "E_p", 1.0, table="Standing"), figure("qp", "E_p", 1.0, table="Standing"),
        figure("learned", "E_p", 1.0, table="Jumping"),
    ]  # fmt: skip
    table = duel_table(figures, "learned", "qp")
    assert list(table.columns) == ["", "learned is better", "qp is better", "too close to call"]
    assert table.rows == [("Walking", "E_p [m]", "E_h [m]", 0), ("Standing", None, None, 1)]


def test_nothing_follows_from_nothing():
    assert conclusions([], "learned", "qp") == []
    equal = [figure(name, "falls", 0.0) for name in ("learned", "qp")]
    assert conclusions(equal[:1], "learned", "learned") == []
    assert conclusions(equal, "learned", "qp")[-1].endswith("learned is better in 0, qp in 0; 1 too close to call.")


def test_the_conclusions_say_what_the_papers_column_is_and_who_taught_the_policy():
    compared, own = [figure("qp", "E_h", 0.5, 1.0)], [figure("qp", "E_h", 0.5)]
    (line,) = provenance(compared, ["qp"])
    assert all(word in line for word in ("another simulator", "wider randomisation", "51.65 kg", "4096 environments"))
    assert provenance(own, ["qp"]) == [] and provenance(own, ["learned", "qp"]) == [THE_TEACHER]
