"""Programs of the checkout that make what ships: nothing in the wheel imports them."""
