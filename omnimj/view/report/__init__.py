"""`report.html` of every command: one file that works offline, on a phone and on paper.

Each module collects texts, tables and figures (`page`) for a template in `templates/`, which escapes texts.
`run` and `run_diagnosis`: a run. `diagnosis`: recorded runs. `gap` and `finding_tables`: the gap workflow.
`identification`, `validation`, `evaluation`, `tuning`, `sensitivity`: one command each.
"""
