"""Whole goals in seeded cells, scored on the truth: the paper's eight tasks with variants, and goals on a table."""
