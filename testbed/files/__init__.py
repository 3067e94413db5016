"""Reading and writing the files of a user: models, campaigns, taps, and the door that all of them come through."""
