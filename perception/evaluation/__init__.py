"""How good a look was, against what truly was there: for scorers only, never an input of perception."""
