"""What holds where nothing is said: numbers that functions of the API and options of the command line share."""

FEED = "0.1016 mm/tooth"
MANY = 6  # effects that a diagnosis until adequate adds at the most
PLAN_SPEEDS, PLAN_DEPTHS = 11, 6  # looked at where no number of them is given
