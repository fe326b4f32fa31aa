"""Language models behind one interface: `open_model(spec).ask(request)`, whoever provides them."""
