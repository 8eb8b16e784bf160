"""Reward specs as data, and a module per reward term (`control.tasks.terms`): predicate, cost, conflicts, hand, texts.

May import `robot` and `safety`.
"""
