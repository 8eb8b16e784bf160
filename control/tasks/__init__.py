"""Reward specs as data, and one module per reward term (`control.tasks.terms`): predicate, cost, conflicts, hand, texts.

May import `robot` and `safety`.
"""
