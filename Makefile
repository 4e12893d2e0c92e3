# Everything runs in its own virtual environment: make demo, make test.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
MTU := $(abspath $(BIN))/mtu
OUT := out
GL := configs/gilsinn-ling
VR := configs/valdes-ring
UN := configs/undeclared
LM := configs/laser-mill

.PHONY: demo test lint type fuzz bench peers-bench loop-bench data pictures clean

# Packages are compiled on all cores after pip, which compiles on one; not what no command of ours
# imports: their own tests, and tools that are compiled already or have done. A few hold files that
# are no Python of this version.
NOT_COMPILED := packages/((pip|setuptools|mypyc?)/|.*/tests/)
define installed
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed" if sys.version_info < (3, 11) else 0)'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e $(1)
	$(BIN)/python -m compileall -qq -j 0 -x '$(NOT_COMPILED)' $(VENV)/lib || true
endef

# Stamps are made again when the project's requirements change.
$(VENV)/.base: pyproject.toml
	$(call installed,.)
	touch $@

$(VENV)/.dev: pyproject.toml
	$(call installed,'.[dev]')
	touch $(VENV)/.base $@

# One by one: a package that the index does not have is told, and the bench goes on without it.
$(VENV)/.peers: $(VENV)/.dev
	$(BIN)/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["peers"], sep="\n")' \
	| while read peer; do \
	  $(BIN)/python -m pip install --quiet --disable-pip-version-check "$$peer" </dev/null \
	  || echo "$$peer cannot be installed: the bench goes on without it"; \
	done
	touch $@

demo: $(VENV)/.base
	@mkdir -p $(OUT)
	@echo "== 1: a simulated machine (configs/gilsinn-ling-simulated): ball-bar readings -> components"
	$(MTU) fit-components configs/gilsinn-ling-simulated -o $(OUT)/components.json --plot $(OUT)/components.png
	@echo "== 1: the same machine: what a part will be like ($(GL)/part.yaml)"
	$(MTU) predict-points -m $(GL)-simulated/machine.yaml -p $(GL)/part.yaml \
	  -c $(OUT)/components.json --plot $(OUT)/points.png
	@echo "== 2: another machine, that of the paper (Gilsinn & Ling 2004, $(GL)): lengths, right angle"
	$(MTU) lengths $(GL) -o $(OUT)/lengths.json --plot $(OUT)/lengths.png
	$(MTU) orthogonality $(GL) --plot $(OUT)/orthogonality.png
	@echo "== 3: a synthetic mill ($(UN)): parts came back from the CMM: are they what was predicted?"
	$(MTU) compare $(UN)
	@echo "== 3: they are not: what does the machine file of this mill not know?"
	$(MTU) close-loop $(UN) -o $(OUT)/loop.json --plot $(OUT)/loop.png \
	  --write-machine $(OUT)/machine-extended.yaml --write-components $(OUT)/components-extended.json
	@echo "== 3: the same parts by this mill with the effect added"
	$(MTU) compare $(UN) -m $(OUT)/machine-extended.yaml --plot $(OUT)/compare.png
	@echo "== 4: a laser's own file of X ($(LM)) -> the table of a control; pictures are in $(OUT)/"
	$(MTU) compensate $(LM) --component dx_x --for linuxcnc --to-file $(OUT)/x.comp

# Many tests start the command: its modules are compiled once before. Those of tests are by pytest.
test: lint type
	$(BIN)/python -m compileall -q -j 0 -x '/test_[^/]*$$' mtu_cli tests
	$(BIN)/python -m pytest -n 2 --dist worksteal --cov --cov-report=

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

type: $(VENV)/.dev
	MYPY_NUM_WORKERS=2 $(BIN)/mypy

# Shipped files, damaged at random, through every reader and command, and the properties of both
# on many examples: about an hour of one core. FUZZ_ARGS='--readers 1000 --seed 2' tries less, or others.
FUZZ_ARGS ?= --readers 110000 --commands 2000
PROPERTIES := $(patsubst %,tests/properties/test_%.py,files_properties language_bounds)
fuzz: $(VENV)/.dev
	PYTHONPATH=tests:tests/cli $(BIN)/python -m fuzz $(FUZZ_ARGS)
	MTU_EXAMPLES=20 $(BIN)/python -m pytest $(PROPERTIES)

bench: $(VENV)/.dev
	$(BIN)/python -m pytest tests/bench --benchmark-disable -q -s -o addopts= -p no:cacheprovider
	$(MAKE) peers-bench

# The right angle by other packages (pyproject.toml, `peers`) as ratios to mtu, in one run.
peers-bench: $(VENV)/.peers
	PYTHONPATH=tests:tests/bench $(BIN)/python -m peers_bench $(PEERS_ARGS)

# How often close-loop is right on simulated sets, against its bar; what was drawn is kept, so that
# a run that was stopped goes on. LOOP_ARGS="--scale 0.1" draws a tenth, "--shard 0/2" every second.
loop-bench: $(VENV)/.dev
	mkdir -p $(OUT)
	PYTHONPATH=tests $(BIN)/python -m loop_bench $(OUT)/loop-bench.jsonl --judging $(LOOP_ARGS)

# The synthetic data under data/, as it was made.
PARTS := --first-repeats 4:5 --parts 21 --repeats 2
data: $(VENV)/.base
	$(MTU) simulate -m $(GL)-simulated/truth.yaml -p $(GL)-simulated/part.yaml --seed 2004 \
	  --positions 10:150:8 --passes 5 --write-lbb data/gilsinn-ling-simulated/lbb.csv
	$(MTU) simulate -m $(GL)-parts/truth.yaml -p $(GL)/part.yaml --seed 2004 $(PARTS) \
	  --operation drilled --cmm-u-um 0.95 \
	  --effect 'Ex: 1e-3*(3.254 - 0.0731*x + 0.0177*y)' --effect 'Ey: 1e-3*(8.738 - 0.0015*x - 0.0723*y)' \
	  --scatter 'Ex: 1e-3*sqrt(253.7 + 0.1677*x - 0.3933*y)' \
	  --scatter 'Ey: 1e-3*sqrt(504.4 + 0.6400*x - 0.2568*y)' \
	  --write-cmm data/gilsinn-ling-parts/drilled.csv
	$(MTU) simulate -m $(GL)-parts/truth.yaml -p $(GL)/part.yaml --seed 1126 $(PARTS) \
	  --operation milled --cmm-u-um 0.9 \
	  --effect 'Ex: 1e-3*(11.785 - 0.0862*x + 0.0277*y)' --effect 'Ey: 1e-3*(11.700 - 0.0377*x - 0.0123*y)' \
	  --scatter 'Ex: 1e-3*sqrt(30.14 + 0.1296*x + 0.2177*y)' \
	  --scatter 'Ey: 1e-3*sqrt(23.67 - 0.0269*x + 0.5230*y)' \
	  --write-cmm data/gilsinn-ling-parts/milled.csv
	$(MTU) simulate -m $(VR)/truth.yaml -p $(VR)/part.yaml --seed 2005 --passes 5 \
	  --positions x=0:500:8,y=0:350:8,z=-300:0:8 --twin 'T_18_degC: T_02_degC' \
	  --drift-positions 'ry_x: 0 300' --drift-positions 'yaw_y: 0 300' \
	  --settled-drift 'pos_y: 28 -4 -34 -38' --settled-drift 'ry_x: 30 30' \
	  --settled-drift 'yaw_y: 30 30' \
	  --parts 2 --repeats 1 --cmm-u-um 0.3 --cmm-room 20 --cmm-room 26 \
	  --covariate 'T_ring_degC: 20 + 6*(sequence - 1)' --write-lbb data/valdes-ring/laser.csv \
	  --write-drift data/valdes-ring/drift.csv --write-cmm data/valdes-ring/ring.csv
	$(MTU) simulate -m $(UN)/truth.yaml -p $(UN)/part.yaml --seed 20040126 \
	  --positions 10:150:8 --passes 5 --parts 21 --repeats 3 --cmm-u-um 0.8 --reverse-every 2 \
	  --covariate 'T_spindle_degC: 22 + 9*(1 - exp(-time_min/45)) + 0.4*sin(time_min/7)' \
	  --covariate 'T_part_degC: 20.4 + 0.6*sin(2*pi*time_min/310) + 0.1*sin(time_min/11)' \
	  --write-lbb data/undeclared/lbb.csv --write-cmm data/undeclared/cmm.csv
	$(MTU) simulate -m $(LM)/truth.yaml -p $(LM)/part.yaml --seed 20041129 \
	  --positions x=0:500:11,y=0:300:7 --parts 12 --cmm-u-um 0.6 --reverse-every 2 \
	  --laser-component dx_x --write-laser data/laser-mill/x.rtl --write-cmm data/laser-mill/cmm.csv
	$(MTU) simulate -m $(LM)/truth.yaml -p $(LM)/part.yaml --seed 20041129 \
	  --positions x=0:500:11,y=0:300:7 --laser-component dy_y --write-laser data/laser-mill/y.rtl
	$(MTU) simulate -m $(LM)/truth-after.yaml --seed 20041130 --positions 0:500:11 \
	  --laser-component dx_x --write-laser data/laser-mill/x-after.rtl

# The pictures of the README, as they were made.
PICTURES := data/pictures
pictures: $(VENV)/.base
	@mkdir -p $(PICTURES) $(OUT)
	$(MTU) fit-components $(UN) -q -o $(OUT)/components.json
	$(MTU) predict-points $(UN) -q -c $(OUT)/components.json --plot $(PICTURES)/points.png
	$(MTU) close-loop $(UN) -q --plot $(PICTURES)/loop.png

clean:
	rm -rf $(VENV) $(OUT)
