"""Which effect is missing: candidates fitted round by round, judged on records held out, and the verdict; one added."""
