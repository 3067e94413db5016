"""Virtual machining testbed: simulate a flexible workpiece being milled, and learn what a model of it lacks."""
