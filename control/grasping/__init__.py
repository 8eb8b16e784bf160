"""Grasps, places and ways to move articulated objects that the arm can really reach. May import `path_planning`."""
