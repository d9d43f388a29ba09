def write_tuning_report(path, outcome, command):
    path.write_text("", encoding="utf-8")
