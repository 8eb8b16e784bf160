"""What a language model is told about its role before each question; each question says the rest itself."""

from collections.abc import Mapping

from prompts.contracts import Role

ROLE_TEXTS: Mapping[Role, str] = {
    "planner": "You plan for a robot arm. Answer exactly in the form that is asked for, without anything around it.",
    "perceiver": "You describe what is seen on a robot's work table. Say only what you see or are told is measured, "
    "in the form that is asked for.",
    "verifier": "You check what others wrote for a robot arm. Judge strictly, and answer exactly in the form that is "
    "asked for.",
}
