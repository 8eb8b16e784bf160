"""Cabinets, microwaves, levers, plates, locks: built into a model, and as perception knows them."""
