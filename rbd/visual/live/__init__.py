"""Live scenes with sliders and choices on their page: values come from the browser, the answer goes back as a picture."""
