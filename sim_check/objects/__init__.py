"""The object library: geometry, mass and friction of what nouns name, in the sizes that are asked for.

    library         builds what a scene name stands for, from its entry in `perception.catalogue`
    bowl, kettle    models: bodies that are no primitives
    solids          the primitives that bodies are made of

Imports no other room.
"""
