"""From hammer blows and frequency responses to the modes of a machine."""
