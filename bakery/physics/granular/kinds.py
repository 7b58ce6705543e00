"""What the extinction coefficient of a medium that stands for packed grains can match: names in recipes and assets."""

CHOICES = ("mean_flight", "second_moment", "random_walk")
