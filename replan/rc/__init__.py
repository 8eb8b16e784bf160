"""The paper's Reasoning & Control benchmark: eight tasks, seeded runs, variants of the method, scored on the truth."""
