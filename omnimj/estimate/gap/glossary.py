"""Words of the gap workflow and their meaning, for the report and the documentation."""

from __future__ import annotations

GLOSSARY: tuple[tuple[str, str], ...] = (
    ("mismatch", "Measured minus simulated, as means over short blocks of samples; RMS over blocks."),
    (
        "noise",
        "Standard deviation of one block mean, from repeats of a run, neighbouring blocks and the known "
        "error of the equations. Channels are compared in multiples of their noise. What remains leaves "
        "out the offset of a run that the model file allows its sensor; tables and plots of single channels "
        "show it.",
    ),
    ("refitted", "An uncertain value of the model file, fitted inside its stated range before any effect."),
    ("effect", "A change of the machine or of a sensor that the model lacks and the library describes."),
    ("held-out runs", "Runs that no fit has seen. They are scored once, at the end."),
    (
        "gain",
        "Share by which an effect reduces the RMS mismatch, in units of noise, of training runs that its fit "
        "left out (cross-validation), with the 90 % interval of a bootstrap over whole conditions.",
    ),
    ("margin", "Gain that the lower end of the interval must exceed for an effect to be named."),
    (
        "random curves",
        "Forces over speed, position or time without any physical meaning, fitted like an effect. p is the "
        "share of them that gain as much as the effect.",
    ),
    (
        "cannot be told apart",
        "Two effects whose predictions, with everything uncertain refitted, differ by no more than the "
        "misfit that is left would explain: that of whole runs, drawn at random.",
    ),
    ("named", "All effects that were found hold given each other, and none can be mistaken for another."),
    ("ambiguous", "For at least one effect there is another that these data cannot tell from it."),
    ("unexplained", "Model and measurement disagree, and the library does not explain it."),
    ("no gap", "After the refit the mismatch is at the level of the noise."),
    ("incomplete", "Effects are named, and more than twice the noise is left: something else is missing."),
    (
        "given up",
        "An effect that was in the model for a while. It did not hold once others were in the model, or it "
        "ran to the bound of its range, where it stands in for something else.",
    ),
    (
        "free curve",
        "A force with eight values over one variable: the most that any effect of it could explain.",
    ),
)
"""Word and meaning, in the order in which a reader meets them."""
