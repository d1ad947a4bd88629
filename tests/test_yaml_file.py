import pytest
import yaml

from hugwbc.errors import MotionFileError, UnknownNameError
from hugwbc.yaml_file import YamlReader, shipped_names, yaml_path


@pytest.fixture
def reader(tmp_path):
    return YamlReader(tmp_path / "a.yaml", MotionFileError)


def node(text):
    return yaml.compose(text, Loader=yaml.SafeLoader)


@pytest.mark.parametrize(
    ("method", "text", "value"),
    [("text", "a b", "a b"), ("number", "1e-2", 0.01), ("integer", "3.0", 3), ("truth", "true", True)],
)
def test_scalars(reader, method, text, value):
    assert getattr(reader, method)(node(text)) == value


@pytest.mark.parametrize(
    ("method", "text", "message"),
    [
        ("text", "[a]", "expected text"),
        ("number", "a", "'a' is not a number"),
        ("integer", "2.5", "2.5 is not a whole number"),
        ("integer", "inf", "'inf' is not a finite number"),
        ("truth", "yes", "'yes' is neither true nor false"),
        ("nodes", "[]", "at least one entry"),
    ],
)
def test_other_values_are_refused_at_their_place(reader, method, text, message):
    with pytest.raises(MotionFileError, match=f"a.yaml:3:4: .*{message}"):
        getattr(reader, method)(node(f"# comment\nk:\n   {text}").value[0][1])


def test_a_name_is_one_of_the_valid_ones(reader):
    assert reader.one_of(node("left"), "side", ("left", "right")) == "left"
    with pytest.raises(MotionFileError, match=r"a\.yaml:1:1: unknown side 'lft'\. Did you mean 'left'"):
        reader.one_of(node("lft"), "side", ("left", "right"))


def test_shipped_files_are_found_by_name_and_others_by_path(tmp_path):
    for name in ("b", "a"):
        (tmp_path / f"{name}.yaml").touch()
    assert shipped_names(tmp_path) == ("a", "b")
    assert yaml_path("thing", "b", tmp_path) == tmp_path / "b.yaml"
    assert str(yaml_path("thing", "mine/c.yml", tmp_path)) == "mine/c.yml"
    with pytest.raises(UnknownNameError, match=r"unknown thing 'c'\. Valid: a, b, or a file that ends in \.yaml"):
        yaml_path("thing", "c", tmp_path)


def test_fields_are_read_by_their_readers(reader):
    readers = {"n": YamlReader.number, "t": YamlReader.text}
    assert reader.fields(node("{n: 1, t: b}"), "thing", readers) == {"n": 1.0, "t": "b"}
    for text, message in (
        ("{m: 1}", "unknown thing field 'm'"),
        ("{n: 1, n: 2}", "thing field 'n' is given twice"),
        ("{n: 1}", "thing field 't' is missing; every thing needs t"),
        ("[n]", "expected a thing with fields: n, t"),
    ):
        with pytest.raises(MotionFileError, match=message):
            reader.fields(node(text), "thing", readers, required=("t",))


def test_files_that_cannot_be_read(reader):
    with pytest.raises(MotionFileError, match="cannot read the thing"):
        reader.load("thing", "write one")
    for text, message in (("", "the file is empty; write one"), ("a: [", r"a.yaml:1:\d+: not valid YAML")):
        reader.path.write_text(text)
        with pytest.raises(MotionFileError, match=message):
            reader.load("thing", "write one")
