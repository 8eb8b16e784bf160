"""docs/glossary.md: one line for each word, in the module that owns it."""

from tests.support.documents import ROOT, module_file, table_rows

ROWS = table_rows((ROOT / "docs" / "glossary.md").read_text())[1:]


def test_every_word_has_a_module_that_exists():
    assert len(ROWS) > 30
    for word, meaning, module in ROWS:
        assert len(meaning) > 20 and module_file(module.strip("`")) is not None, (
            f"'{word}' belongs to no module: {module}"
        )


def test_no_word_is_explained_twice():
    words = [word for row in ROWS for word in row[0].split(", ")]
    assert sorted(set(words)) == sorted(words)


def test_a_module_speaks_of_the_word_that_it_owns():
    for word, _, module in ROWS:
        file = module_file(module.strip("`"))
        assert file is not None
        text = file.read_text().lower().replace("_", " ").replace("\n", " ")
        stems = [part.strip("`")[:5].lower() for part in word.split(", ")[0].split()]
        assert any(stem in f"{module.lower()} {text}" for stem in stems), f"{module} says nothing of '{word}'"
