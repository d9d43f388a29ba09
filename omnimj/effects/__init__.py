"""Named pieces of physics that a model may lack, and what each changes in a plant."""
