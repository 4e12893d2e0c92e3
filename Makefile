# Everything runs in its own virtual environment: make demo, make test.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
MTU := $(abspath $(BIN))/mtu
OUT := out

.PHONY: demo test lint type bench clean

# Stamps are made again when the project's requirements change.
$(VENV)/.base: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed" if sys.version_info < (3, 11) else 0)'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	touch $@

$(VENV)/.dev: $(VENV)/.base
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	touch $@

demo: $(VENV)/.base
	@mkdir -p $(OUT)
	@echo "== simulated ball-bar readings of the machine -> its components"
	$(MTU) fit-components configs/gilsinn-ling-simulated -o $(OUT)/components.json --plot $(OUT)/components.png
	@echo "== and what its parts will be like"
	$(MTU) predict-points configs/gilsinn-ling-simulated -c $(OUT)/components.json --plot $(OUT)/points.png
	$(MTU) orthogonality configs/gilsinn-ling --plot $(OUT)/orthogonality.png
	@echo "== lengths of the paper's machine (Gilsinn & Ling 2004); pictures are in $(OUT)/"
	$(MTU) lengths configs/gilsinn-ling -o $(OUT)/lengths.json --plot $(OUT)/lengths.png

test: lint type
	$(BIN)/python -m pytest -n 2

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

type: $(VENV)/.dev
	$(BIN)/mypy

bench: $(VENV)/.dev
	$(BIN)/python -m pytest tests/bench --benchmark-disable -q -s -o addopts= -p no:cacheprovider

clean:
	rm -rf $(VENV) $(OUT)
