"""The hybrid: somebody chooses one of five behaviours each second, and PDM moves the car accordingly."""
