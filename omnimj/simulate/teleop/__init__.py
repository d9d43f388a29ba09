"""A person drives: keys and sticks become targets, and the loop goes on until the person has had enough."""
