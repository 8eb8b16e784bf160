"""Reward terms as data: vocabulary, predicates, costs, conflicts, what a term asks of the hand. May import `safety`."""
