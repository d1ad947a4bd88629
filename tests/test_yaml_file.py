import pytest
import yaml

from hugwbc.errors import MotionFileError
from hugwbc.yaml_file import YamlReader


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
        ("integer", "inf", "inf is not a whole number"),
        ("truth", "yes", "'yes' is neither true nor false"),
        ("nodes", "[]", "at least one entry"),
    ],
)
def test_other_values_are_refused_at_their_place(reader, method, text, message):
    with pytest.raises(MotionFileError, match=f"a.yaml:3:4: .*{message}"):
        getattr(reader, method)(node(f"# comment\nk:\n   {text}").value[0][1])


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
