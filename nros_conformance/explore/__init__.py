"""Testing the suites themselves, and searching beyond them: mutants, generated timelines, differential runs."""
