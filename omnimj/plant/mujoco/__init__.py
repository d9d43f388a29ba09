"""The MuJoCo twin: native wheel contact, models, faults."""
