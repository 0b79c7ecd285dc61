"""Small changes to the code, each of which the tests nearest to it must notice: `make mutants`."""
