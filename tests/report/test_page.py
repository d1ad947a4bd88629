from hugwbc.evaluation.tables import Marked, Table
from hugwbc.report import page


def test_text_is_escaped_everywhere():
    nasty = "<script>alert(1)</script>"
    table = Table(nasty, ("", nasty), [(nasty, Marked(nasty, "worse"))], nasty)
    parts = [page.heading(nasty), page.paragraph(nasty), page.bullets([nasty]), page.table_html(table)]
    parts += [page.links({nasty: nasty}), page.legend([nasty], ["#123456"], nasty)]
    assert "<script" not in page.page_html(nasty, parts)


def test_marks_are_classes_and_headings_are_targets():
    rows = [("E", Marked("2", "worse"), Marked("3", "published"), 4.0)]
    html = page.table_html(Table("Single command, walking", ("", "a", "b", "c"), rows), level=3)
    assert '<td class="worse">2 worse</td><td class="published">3</td><td>4</td>' in html
    assert '<h3 id="single-command-walking">Single command, walking</h3>' in html
    assert page.anchor("Single command, walking") == "single-command-walking"


def test_a_folded_section_has_its_anchor_inside_so_that_links_open_it():
    html = page.folded("A <b>", "<p>inside</p>")
    assert html.startswith("<details><summary><h2>A &lt;b&gt;</h2></summary>")
    assert html.index("</summary>") < html.index(f'id="{page.anchor("A <b>")}"') < html.index("<p>inside</p>")


def test_commands_between_backticks_are_code():
    assert page.paragraph("Run `hugwbc <x>`.") == "<p>Run <code>hugwbc &lt;x&gt;</code>.</p>"
    assert "<li><code>a</code> and b</li>" in page.bullets(["`a` and b"])
