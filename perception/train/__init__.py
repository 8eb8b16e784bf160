"""Training of the bundled detector and segmenter on labelled pictures: `python -m perception.train --help`."""
