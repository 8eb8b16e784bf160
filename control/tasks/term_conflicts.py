"""Terms of one reward spec that cannot hold together, found before any search.

The motion search reads the primary term and lets the others shape the cost, so it would happily meet one of two terms
that exclude each other. What is found here needs no simulation: some of it the terms alone say, some of it sizes and
places in the twin. Each term says itself which others it excludes (`TermDefinition.excludes`; docs/reward-terms.md).

Terms about the palm beside a primary term about an object are meant for the way there (`control.tasks.motion_cost`):
they are held at different times and exclude nothing.
"""

from itertools import combinations

from control.errors import TermConflictError
from control.tasks.reward_spec import PALM, RewardSpec
from control.tasks.subtasks import posed_objects
from control.tasks.terms.views import Layout
from control.twin_model import TwinModel


def refuse_term_conflicts(spec: RewardSpec, twin: TwinModel | None = None) -> None:
    """Raise when two terms of a spec cannot both be met.

    Args:
        spec: What to achieve.
        twin: For sizes and places; without it only what the terms alone say is found.

    Raises:
        TermConflictError: Two terms conflict; the message names both and says why.
    """
    layout = Layout({}, None) if twin is None else Layout(posed_objects(twin, twin.start()), twin.support_height)
    about_palm = PALM in (spec.primary.subject, spec.primary.target)
    lasting = [t for t in spec.terms if about_palm or PALM not in (t.subject, t.target)]
    for a, b in combinations(lasting, 2):
        why = a.definition.excludes(a, b, layout) or b.definition.excludes(b, a, layout)
        if why:
            raise TermConflictError(
                f"{a.text} and {b.text} cannot both be met: {why}; leave one of them out, or ask for one after the "
                "other"
            )
