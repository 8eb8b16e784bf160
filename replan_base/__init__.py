"""What every folder stands on: the release, the root of all errors, which packages are ours, where old modules went.

Needs only the standard library, and imports none of the other folders.
"""

__version__ = "0.2.0"
