"""What comes: temperatures and thermal error over the next hour, by the program that runs or one given."""
