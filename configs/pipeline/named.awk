# The files that a study names in its mtu.yaml, one a line; of one `role` (machine, part, ...) where
# it is given. A name that this reads otherwise than mtu does is no file: its steps run every time.
BEGIN { roles = role ? role : "machine|part|components|lbb|laser|cmm|drift" }
{ sub(/(^|[ \t])#.*/, ""); sub(/\r$/, "") }
/^["']?[A-Za-z_]+["']?[ \t]*:/ {
	key = $0
	sub(/[ \t]*:.*/, "", key)
	gsub(/["']/, "", key)
	named = key ~ "^(" roles ")$"
	sub(/^[^:]*:/, "")
}
named {
	gsub(/[]["']/, "")
	count = split($0, names, ",")
	for (i = 1; i <= count; i++) {
		sub(/^[ \t]*(-[ \t]+)?/, "", names[i])
		sub(/[ \t]+$/, "", names[i])
		if (names[i] != "") print names[i]
	}
}
