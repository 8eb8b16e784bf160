"""Scenes, estimates and twins that benchmarks and tests start from; built without a look at anything."""
