"""One module a command: options in, a frozen result out; no files, no drawing."""
