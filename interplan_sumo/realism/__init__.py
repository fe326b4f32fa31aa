"""Layer 3: drivers fitted to recordings of real traffic, and how real simulated traffic is beside them."""
