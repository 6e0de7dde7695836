"""Examples in the documentation, and that everything is documented."""

import doctest
import importlib.util
import inspect
import pathlib
import runpy

import reagent

PUBLIC = {name: getattr(reagent, name) for name in dir(reagent) if not name.startswith("_")}


def test_examples_of_docstrings():
    parser, attempted = doctest.DocTestParser(), 0
    documented = [reagent, *PUBLIC.values()]
    documented += [member for kind in PUBLIC.values() if inspect.isclass(kind) for member in vars(kind).values()]
    for item in documented:
        text = getattr(item, "__doc__", None) or ""
        runner = doctest.DocTestRunner(optionflags=doctest.IGNORE_EXCEPTION_DETAIL)
        result = runner.run(parser.get_doctest(text, {}, str(item), None, 0))
        assert result.failed == 0, item
        attempted += result.attempted
    assert attempted > 15


def test_everything_is_documented():
    for name, item in PUBLIC.items():
        if inspect.ismodule(item):
            continue
        assert item.__doc__, name
        if not inspect.isclass(item) or issubclass(item, Exception):
            continue
        for member, value in vars(item).items():
            assert member.startswith("_") or value.__doc__, f"{name}.{member}"


def test_the_page_and_the_example(tmp_path):
    folder = pathlib.Path(__file__).parents[1]
    page = (folder / "README.md").read_text()
    code = page.split("```python\n")[1].split("```")[0]
    exec(compile(code, "README.md", "exec"), {})
    example = runpy.run_path(str(folder / "examples/register_part.py"))
    picture = tmp_path / "part.png"
    found = example["main"](str(picture))
    assert found.converged
    if importlib.util.find_spec("matplotlib"):
        assert picture.read_bytes().startswith(b"\x89PNG")
