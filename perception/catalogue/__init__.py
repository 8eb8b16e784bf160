"""What is known of things by their nouns, as data: one entry an object in `objects.yaml`.

    objects.yaml     the entries: words, colours, looks, bodies, how random scenes draw them; colour words; furniture
    entries          what the file may say, with units and defaults; unknown keys are mistakes
    catalogue        reads the file (`read_catalogue`, `builtin_catalogue`) and answers from it
    appearance       types: what a colour and a noun look like
    phrases          colour words and nouns read out of a phrase such as "red cube"
    colour_words     which colour pixels have, in a word

Detection, fits, the object library, random scenes, the language of goals and the training of detectors read their facts
here. Nothing is read before somebody asks. Imports frames and estimates only.
"""
