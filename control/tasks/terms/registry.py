"""The reward terms that exist. A term is added by one module beside this one and one line here."""

from control.tasks.terms.joint_fraction import SetJointFraction
from control.tasks.terms.maximize_distance import MaximizeDistance
from control.tasks.terms.minimize_distance import MinimizeDistance
from control.tasks.terms.object_height import SetObjectHeight
from control.tasks.terms.object_orientation import SetObjectOrientation
from control.tasks.terms.vocabulary import Vocabulary

TERMS = Vocabulary(
    (
        MinimizeDistance(),
        MaximizeDistance(),
        SetJointFraction(),
        SetObjectHeight(),
        SetObjectOrientation(),
    )
)
