"""The tests that `make near` chooses for a changed file."""

import pytest

from campaigns.mutants.nearest import NEAREST
from tests.near import MOST_FILES, ROOT, main, nearest


def test_a_module_that_mutants_are_tried_on_has_the_tests_of_its_list() -> None:
    file, listed = next(iter(NEAREST.items()))
    assert nearest(file) == listed.tests


def test_another_module_has_the_tests_that_import_it_and_those_of_its_folder_first() -> None:
    found = nearest("observer/model/settle.py")
    assert found[0].startswith("tests/model/")
    assert all((ROOT / path).is_file() for path in found)


def test_a_module_that_half_the_suite_imports_has_only_a_few_tests() -> None:
    assert len(nearest("observer/frames.py")) == MOST_FILES


def test_a_test_file_is_nearest_to_itself() -> None:
    assert nearest("tests/test_near.py") == ("tests/test_near.py",)


def test_a_file_that_does_not_exist_ends_with_a_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["observer/nothing.py"]) == 2
    assert "observer/nothing.py: there is no such file" in capsys.readouterr().err
