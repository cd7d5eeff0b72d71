"""Jobs of dpr-lab, one per file: files to results, with typed progress events.

Command line, screen, demo, trials and notebooks use these jobs. A job is a function

    job(request, on_event) -> result

of a frozen request that contains file names and options. It writes the files that the request names, reports progress
to `on_event` (`workflows.events`) and never prints. The callers display events and result; they parse no text.
Importing a job is fast: large libraries are imported when it runs, so that the process that draws a screen can refer to
jobs that another process executes.
"""
